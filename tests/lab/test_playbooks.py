"""Playbooks that users add, on real robots: done once, mended, refused unasked, replaced from one's own folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, ROOT, Lab, busybox, changed, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot1"
MARKER, ASKED, MOTD = "/opt/pb-marker", "/opt/pb-asked", "/var/lib/srprov/pb/motd"
SETUP = f"""\
- command: marker is there
  shell: touch {MARKER}
  unless: touch {ASKED}; test -e {MARKER}
- file: {{{{ folder ~ "/motd" }}}}
  content: {{{{ "hello from " ~ host ~ "\\n" }}}}
"""
STEPS = {f"{ROBOT}/command:marker is there", f"{ROBOT}/file:{MOTD}"}


class Trial:
    """An experiment with a playbook, on one robot, and a home of its own."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.folder = lab, folder
        self.inventory = part_of_lab(lab, (ROBOT,), folder / "lab.yml")
        self.edf = folder / "experiment.edf"
        self.config = folder / "config"
        (folder / "setup.yml").write_text(SETUP, encoding="utf-8")
        self.write({"before": ["setup.yml"]})

    def write(self, playbooks: dict[str, Any]) -> None:
        """Write the EDF."""
        more = {"playbooks": playbooks} if playbooks else {}
        self.edf.write_text(edf("pb", {"one": busybox(robot=ROBOT)}, **more), encoding="utf-8")

    def srprov(self, verb: str, *more: str, file: Path | None = None) -> Any:
        """Run a verb for the experiment, with the trial's own configuration."""
        words = (verb, str(file or self.edf), "-i", self.inventory, *more)
        return self.lab.srprov(*words, env={"XDG_CONFIG_HOME": str(self.config)})

    def apply(self, *more: str, file: Path | None = None) -> Any:
        """Apply without a question."""
        return self.srprov("apply", "--yes", "--json", "--settle", "0", *more, file=file)

    def there(self, *paths: str) -> set[str]:
        """Give which paths the robot has, by its own shell."""
        out = self.lab.shell(ROBOT, "sh", "-c", f"ls -d {' '.join(paths)} 2>/dev/null; true").out
        return set(out.split())


@pytest.fixture
def trial(lab: Lab, tmp_path: Path) -> Any:
    """Give the trial; what its commands made is nobody's, so it is taken away here."""
    one = Trial(lab, tmp_path)
    lab.shell(ROBOT, "rm", "-f", MARKER, ASKED)
    yield one
    lab.shell(ROBOT, "rm", "-f", MARKER, ASKED)


def test_a_playbook_is_done_once_mended_and_taken_away(trial: Trial) -> None:
    """Apply makes it true, a second one changes nothing, drift is mended, and destroy leaves only what commands did."""
    first = trial.apply("--allow", "playbook")
    assert first.code == 0, first
    assert changed(first.json) >= STEPS
    assert trial.there(MARKER, MOTD) == {MARKER, MOTD}
    assert trial.lab.shell(ROBOT, "cat", MOTD).out == f"hello from {ROBOT}\n"
    record = Path(first.json["run"])
    assert (record / "inputs" / "setup.yml").read_text(encoding="utf-8") == SETUP

    second = trial.apply("--allow", "playbook")
    assert (second.code, second.json["changed"], second.json["failed"]) == (0, 0, 0), second
    assert trial.srprov("plan", "--detailed-exitcode", "--allow", "playbook").code == 0

    trial.lab.shell(ROBOT, "sh", "-c", f"rm {MARKER}; echo other > {MOTD}")
    plan = trial.srprov("plan", "--detailed-exitcode", "--allow", "playbook")
    assert plan.code == 2, plan
    assert "setup.yml  before srprov's own, from the experiment" in plan.out
    assert f"setup.yml:1: runs: touch {MARKER}; its check, which plan runs too: touch {ASKED}" in plan.out
    assert "! #1 command marker is there: its check exits with 1" in plan.out
    mended = trial.apply("--allow", "playbook")
    assert (mended.code, changed(mended.json)) == (0, STEPS), mended
    assert trial.there(MARKER) == {MARKER}
    assert trial.lab.shell(ROBOT, "cat", MOTD).out == f"hello from {ROBOT}\n"

    trial.write({})
    gone = trial.apply()
    assert (gone.code, changed(gone.json)) == (0, {f"{ROBOT}/file:{MOTD}"}), gone
    assert trial.there(MARKER, MOTD) == {MARKER}

    assert trial.srprov("destroy", "--yes").code == 0
    assert trial.lab.leftovers(ROBOT) == NOTHING


@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"]])
def test_without_permission_the_robot_hears_of_nothing(trial: Trial, verb: list[str]) -> None:
    """Exit 9 names playbook, command and check; neither ran: the check itself would have left a file."""
    refused = trial.srprov(*verb)
    assert refused.code == 9, refused
    assert "setup.yml: playbook" in refused.err and f"touch {ASKED}" in refused.err
    assert "--allow playbook" in refused.err
    assert trial.there(MARKER, ASKED) == set()
    assert trial.lab.leftovers(ROBOT) == NOTHING


def test_a_projects_configuration_cannot_allow_it(trial: Trial, tmp_path: Path) -> None:
    """What comes with the experiment may not give permission to itself; the user's own file may."""
    (trial.lab.folder / "srprov.toml").write_text('allow = ["playbook"]\n', encoding="utf-8")
    try:
        refused = trial.srprov("plan")
    finally:
        (trial.lab.folder / "srprov.toml").unlink()
    assert refused.code == 5, refused
    assert trial.there(ASKED) == set()
    (trial.config / "srprov").mkdir(parents=True)
    (trial.config / "srprov" / "srprov.toml").write_text('allow = ["playbook"]\n', encoding="utf-8")
    assert trial.srprov("plan").code == 0


def test_a_plan_file_says_what_runs(trial: Trial) -> None:
    """The playbook may change or be gone by then; needing permission again; stale once the check holds."""
    file = trial.folder / "plan.json"
    assert trial.srprov("plan", "--allow", "playbook", "-o", str(file)).code == 0
    assert json.loads(file.read_text())["inputs"]["setup.yml"] == SETUP
    (trial.folder / "setup.yml").write_text("- broken", encoding="utf-8")
    assert trial.apply(file=file).code == 9
    done = trial.apply("--allow", "playbook", file=file)
    assert done.code == 0, done
    assert trial.there(MARKER, MOTD) == {MARKER, MOTD}
    stale = trial.apply("--allow", "playbook", file=file)
    assert stale.code == 6, stale
    assert "command:marker is there holds: was false, is true" in stale.err


def test_a_command_that_misses_its_check_fails(trial: Trial) -> None:
    """It ended well and its check still fails: exit 3 with both in words, and nothing that comes after is begun."""
    text = "- command: does nothing\n  argv: ['true']\n  creates: /opt/never\n"
    (trial.folder / "setup.yml").write_text(text, encoding="utf-8")
    failed = trial.apply("--allow", "playbook")
    assert failed.code == 3, failed
    assert "it ran, and did not converge: /opt/never is not there" in failed.err
    assert trial.lab.containers(ROBOT) == {}


def test_the_users_folder_replaces_ours_and_adds(trial: Trial) -> None:
    """A file named like ours replaces it, another one is added; both show in the plan, and need no permission."""
    mine = trial.config / "srprov" / "playbooks"
    mine.mkdir(parents=True)
    shutil.copy(ROOT / "playbooks" / "40-services.yml", mine)
    with (mine / "40-services.yml").open("a", encoding="utf-8") as stream:
        stream.write('- file: {{ folder ~ "/motd" }}\n  content: "mine"\n')
    (mine / "35-marker.yml").write_text(f"- command: m\n  argv: [touch, {MARKER}]\n  creates: {MARKER}\n")
    trial.write({})

    done = trial.apply()

    assert done.code == 0, done
    assert trial.lab.shell(ROBOT, "cat", MOTD).out == "mine"
    assert trial.there(MARKER) == {MARKER}
    assert set(trial.lab.containers(ROBOT, running=True)) == {"srprov.pb.one"}
    plan = trial.srprov("plan", "--detailed-exitcode")
    assert plan.code == 0, plan
    assert f"40-services.yml  replaces srprov's own, from {mine}/40-services.yml" in plan.out
    assert f"35-marker.yml    added, from {mine}/35-marker.yml" in plan.out
    (mine / "35-marker.yml").write_text("- comand: m\n", encoding="utf-8")
    broken = trial.srprov("plan")
    assert (
        broken.code == 5 and f"{mine}/35-marker.yml:1:3: error[SRP-141]: there is no module 'comand'" in broken.err
    ), broken
