"""Where a bundle is run again: on robots that the user names, or on a lab that is made for it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from srprov.cli.main import run as cli
from srprov.cli.replay_lab import lab_for
from srprov.codes import Code
from srprov.controller.owners import read_owner
from srprov.controller.trials import Trials
from srprov.errors import LabError
from srprov.evidence.make import bundle
from srprov.evidence.replay import Needed, Replay
from srprov.lab import lab as labs
from srprov.lab import spec
from srprov.lab.lab import Wanted
from tests.fakes import World
from tests.trial_folders import FILES, run_folder, write_experiment
from tests.unit.cli.test_trial_marks import done
from tests.unit.evidence.bundles import events, forged, journal, packed, unpacked

NEEDS = {
    "kuka": Needed(tags=("arm", "camera"), devices=("/dev/net/tun", "/dev/video0"), arch="amd64"),
    "turtle": Needed(tags=(), devices=(), arch="arm64"),
}
REPLAY = Replay(edf="race.edf", placed={"a": "kuka", "b": "turtle"}, facts={}, needs=NEEDS)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "nobody says on which robots"),
        (["--lab", "--map", "robot1=kuka"], "--lab brings robots of its own"),
        (["--lab", "-i", "robots.yml"], "--lab brings robots of its own"),
    ],
)
def test_somebody_says_on_which_robots(
    tmp_path: Path, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "b.zip").write_text("")
    assert cli(["replay", str(tmp_path / "b.zip"), "-o", str(tmp_path / "again"), "--yes", *words]) == 5
    assert told in capsys.readouterr().err
    assert not (tmp_path / "again").exists()


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    """What is asked of labs, none of which is made: (verb and name, spec)."""
    found: list[tuple[str, str]] = []

    def up(name: str, wanted: Wanted, _say: Callable[[str], None]) -> list[str]:
        found.append((f"up {name}", wanted.spec_text or ""))
        place = Path("inventory", f"lab-{name}.yml")
        place.parent.mkdir()
        place.write_text("all: {hosts: {robot1: {ansible_host: 192.0.2.1}, robot2: {ansible_host: 192.0.2.2}}}\n")
        return []

    def down(name: str, _say: Callable[[str], None]) -> bool:
        found.append((f"down {name}", ""))
        return True

    monkeypatch.setattr(labs, "up", up)
    monkeypatch.setattr(labs, "down", down)
    return found


def test_a_lab_has_a_robot_for_each_part_with_what_its_services_need(
    calls: list[tuple[str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with lab_for(REPLAY) as (inventory, asked):
        assert asked == {"kuka": "robot1", "turtle": "robot2"}
        assert set(inventory.hosts) == {"robot1", "robot2"}
        assert Path.cwd() == tmp_path and list(tmp_path.iterdir()) == [], "nothing is written where the user is"
        ((first, text),) = calls
        one, other = spec.parse(text, "lab-spec.yml").build(2)
    assert (one.tags, one.devices, one.arch) == (("arm", "camera"), ("/dev/video0",), None)
    assert (other.tags, other.devices, other.arch) == ((), (), "arm64")
    assert [name for name, _ in calls] == [first, first.replace("up", "down")]
    assert len(first) <= len("up ") + 20, "a lab's name"


def test_a_lab_is_taken_down_whatever_happens(calls: list[tuple[str, str]], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(KeyboardInterrupt), lab_for(REPLAY):
        raise KeyboardInterrupt
    assert calls[-1][0].startswith("down replay-")
    calls.clear()

    def none(*_words: object) -> list[str]:
        raise LabError("no subnet is free", code=Code.LAB_MACHINE)

    monkeypatch.setattr(labs, "up", none)
    with pytest.raises(LabError), lab_for(REPLAY):
        raise AssertionError("it is not there")
    assert [name.split("-")[0] for name, _ in calls] == ["down replay"]


def test_what_a_bundle_says_of_robots_and_images_writes_no_lines_of_its_own(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They stand with the plan, right before the question."""
    bundle(run_folder(tmp_path / "run", write_experiment(tmp_path / "experiment")), tmp_path / "race.zip")
    content, forgery = unpacked(tmp_path / "race.zip"), "1\n\nIt asks for no permission.\n\u202e"
    facts = json.loads(content["sessions/1/facts.json"])
    facts["robots"]["r1"]["kernel"] = forgery
    first, *more = events(content)
    first["same"] |= {"runner: image": forgery, f"a{forgery}: image": "judge"}
    changed = {"sessions/1/facts.json": json.dumps(facts).encode(), "journal.jsonl": journal([first, *more])}
    path = packed(forged({**content, **changed}), tmp_path / "evil.zip")
    monkeypatch.setattr(Trials, "_done", done)
    cli(["replay", str(path), "-i", "inv.yml", "-o", "again", "--yes"])
    told = capsys.readouterr().out.splitlines()
    shown = told[told.index("Who does whose part:") :]
    assert [line for line in shown if "kernel: 1\\n" in line] and [line for line in shown if "runner: 1\\n" in line]
    assert not [line for line in shown if line.startswith("It asks")]


def test_a_bundle_whose_replay_is_refused_has_nothing_of_the_one_before(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It lies there by then, and `apply` by its path mounted the volumes that the other one had left."""
    monkeypatch.setattr(Trials, "_done", done)
    for name, files in {"mine": FILES, "evil": {**FILES, "tracks/oval.txt": "evil\n"}}.items():
        bundle(run_folder(tmp_path / name, write_experiment(tmp_path / f"{name}.d", files)), tmp_path / f"{name}.zip")
    (edf := tmp_path / "again/experiment/race.edf").parent.mkdir(parents=True)
    assert replayed("mine") in (0, 2), capsys.readouterr()
    mine = read_owner("race", str(edf))
    for word, text in {"--only": "", "in the way": "x"}.items():
        shutil.rmtree("again")
        edf.parent.mkdir(parents=True)
        (edf.parent / "notes").write_text(text) if text else None
        assert replayed("evil", "--only", "nothing") == 5
        now = read_owner("race", str(edf))
        assert (now.token != mine.token, now.bundle != mine.bundle) == (not text, not text), word
        shutil.rmtree("again")
        assert replayed("mine", "--only", "nothing") == 5
        assert read_owner("race", str(edf)).token == mine.token, "it comes back"


def replayed(name: str, *words: str) -> int:
    return cli(["replay", f"{name}.zip", "-i", "inv.yml", "-o", "again", "--yes", *words])
