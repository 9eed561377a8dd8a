"""A new experiment from `init` on, files in and out of its containers, and logins on its robots."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.lab.conftest import ROOT, Done, Lab, part_of_lab
from tests.lab.looks import begin, wait_until
from tests.lab.test_daily_use import Terminal

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")


@dataclass
class Begun:
    """The experiment that `init` wrote, as it runs."""

    lab: Lab
    folder: Path
    inventory: str
    applied: Done

    @property
    def words(self) -> tuple[str, ...]:
        """What every verb is told."""
        return str(self.folder / "experiment.edf"), "-i", self.inventory

    def run(self, verb: str, *more: str) -> Done:
        """Run a verb on it."""
        return self.lab.srprov(verb, *self.words, *more)

    def robot(self, service: str) -> str:
        """Give the robot that runs a service, by Docker's word."""
        return next(robot for robot in ROBOTS if f"srprov.my-first.{service}" in self.lab.containers(robot))

    def inside(self, service: str, script: str) -> str:
        """Run a script in a service's container by Docker's own means; give what it prints."""
        words = ("docker", "exec", f"srprov.my-first.{service}", "sh", "-c", script)
        return self.lab.shell(self.robot(service), *words).out


@pytest.fixture(scope="module")
def begun(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Begun]:
    """Write a new experiment, and apply it as it is, but for the robots' addresses."""
    lab, folder = lab_of_module, tmp_path_factory.mktemp("files") / "My First"
    made = lab.srprov("init", str(folder))
    assert made.code == 0, made
    inventory = part_of_lab(lab, ROBOTS, folder / "inventory.yml")
    assert lab.srprov("validate", str(folder / "experiment.edf"), inventory).code == 0
    one = Begun(lab, folder, inventory, Done(0, "", ""))
    one.applied = one.run("apply", "--yes", "--settle", "0")
    yield one
    assert one.run("destroy", "--yes", "--volumes").code == 0


def test_a_new_experiment_runs_as_it_was_written(begun: Begun) -> None:
    """Each service on a robot of its own; what one says, the other hears; and what is to come home does."""
    assert begun.applied.code == 0, begun.applied
    assert {begun.robot("talker"), begun.robot("listener")} == set(ROBOTS)
    heard = begun.run("wait", "--until", "log:listener=^heard: hello #[0-9]+", "--wait-timeout", "60")
    assert heard.code == 0, heard
    home = begun.run("collect", "-o", str(begun.folder / "collected"))
    assert home.code == 0, home
    words = [one.read_text() for one in (begun.folder / "collected").rglob("word.txt")]
    assert len(words) == 1 and words[0].startswith("hello #")
    again = begun.run("plan", "--detailed-exitcode")
    assert again.code == 0, again


def test_files_go_in_and_come_out_as_they_are(begun: Begun, tmp_path: Path) -> None:
    """By size, hash, mode and owner, as the container sees them; also what is larger than any buffer."""
    here = tmp_path / "in"
    (here / "deep").mkdir(parents=True)
    data = os.urandom(24 << 20)
    (here / "deep/large").write_bytes(data)
    (here / "run.sh").write_text("echo it ran")
    (here / "run.sh").chmod(0o755)
    (here / "link").symlink_to("deep/large")
    put = begun.run("cp", "--owner", "1000:1001", str(here), "talker:/got")
    assert put.code == 0 and "2 files, 24.0 MiB copied" in put.err, put
    seen = begun.inside("talker", "cd /got; sha256sum <deep/large; stat -c '%a %u %g' run.sh; readlink link; sh run.sh")
    assert seen.split("\n") == [f"{hashlib.sha256(data).hexdigest()}  -", "755 1000 1001", "deep/large", "it ran", ""]

    back = begun.run("cp", f"talker@{begun.robot('talker')}:/got", str(tmp_path / "out"))
    assert back.code == 0, back
    assert (tmp_path / "out/deep/large").read_bytes() == data
    assert (tmp_path / "out/link").read_bytes() == data and not (tmp_path / "out/link").is_symlink()
    assert os.access(tmp_path / "out/run.sh", os.X_OK)

    # what is there is replaced, the other way too; a stopped container has files as well
    (tmp_path / "word").write_text("another word\n")
    assert begun.run("stop", "talker", "--yes").code == 0
    assert begun.run("cp", str(tmp_path / "word"), "talker:/got/run.sh").code == 0
    assert begun.run("cp", "talker:/got/run.sh", str(tmp_path / "word2")).code == 0
    assert (tmp_path / "word2").read_text() == "another word\n"
    assert begun.run("start", "talker", "--yes").code == 0
    planned = begun.run("plan", "--detailed-exitcode")
    assert planned.code == 0, planned  # what was copied is no part of the experiment


def test_tars_go_through_pipes(begun: Begun, tmp_path: Path) -> None:
    """From one container into another, by two of them."""
    begun.inside("talker", "mkdir -p /a/b && echo deep >/a/b/c && ln -s /nowhere /a/out")
    srprov = [sys.executable, "-m", "srprov", "cp", *begun.words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (tmp_path / "a.tar").open("wb") as tar:
        got = subprocess.run(
            [*srprov, "talker:/a", "-"], stdout=tar, cwd=begun.lab.folder, env=environment, timeout=120
        )
    assert got.returncode == 0
    with tarfile.open(tmp_path / "a.tar") as read:
        assert {"a/b/c", "a/out"} <= set(read.getnames())
    with (tmp_path / "a.tar").open("rb") as tar:
        put = subprocess.run(
            [*srprov, "-", "listener:/"], stdin=tar, cwd=begun.lab.folder, env=environment, timeout=120
        )
    assert put.returncode == 0
    assert begun.inside("listener", "cat /a/b/c; readlink /a/out") == "deep\n/nowhere\n"


def test_what_a_container_has_cannot_lead_out_of_the_copy(begun: Begun, tmp_path: Path) -> None:
    """Links, pipes and devices that a service made are told and left there; nothing beside the copy changes."""
    begun.inside(
        "talker",
        "mkdir -p /evil/sub && cd /evil && echo fine >file && ln -s /etc/passwd abs && ln -s ../../secret up "
        "&& ln -s sub/../.. around && ln -s file in && mkfifo pipe && mknod null c 1 3 && ln file hard",
    )
    (tmp_path / "secret").write_text("mine")
    copied = begun.run("cp", "talker:/evil", str(tmp_path))
    assert copied.code == 3, copied
    assert sorted(os.listdir(tmp_path / "evil")) == ["file", "hard", "in", "sub"]
    for name in ("abs: a link", "up: a link", "around: a link", "pipe: a device", "null: a device"):
        assert f"left out: evil/{name}" in copied.err
    assert (tmp_path / "secret").read_text() == "mine" and sorted(os.listdir(tmp_path)) == ["evil", "secret"]


def test_no_name_of_a_container_becomes_that_of_a_file_of_the_user_s(begun: Begun, tmp_path: Path) -> None:
    """The map that he sends back, by `cp` or by `apply`, would be any file that lies beside it."""
    maps = tmp_path / "maps"
    maps.mkdir()
    (maps / "site.yaml").write_text("mine\n")
    begun.inside("talker", "mkdir -p /maps && cd /maps && echo new >new.yaml && ln -s site.yaml hall.yaml")
    copied = begun.run("cp", "talker:/maps/.", str(maps))
    sent = begun.run("cp", str(maps / "hall.yaml"), "talker:/tmp/hall.yaml")
    told = begun.inside("talker", "cat /tmp/hall.yaml || echo nothing")
    assert copied.code == 3 and "left out: hall.yaml: a link to what did not come with it" in copied.err, copied
    assert sent.code == 5 and told == "nothing\n", sent
    assert sorted(os.listdir(maps)) == ["new.yaml", "site.yaml"]


def test_no_name_of_a_robot_s_becomes_that_of_another_one_s_file(begun: Begun, tmp_path: Path) -> None:
    """Both have their maps brought into one folder; the first one's link would lead to what the second one brings."""
    maps = tmp_path / "maps"
    maps.mkdir()
    script = "mkdir -p /halls && cd /halls && echo {} >site.yaml"
    begun.inside("talker", script.format("decoy") + " && ln -s site.yaml hall.yaml && ln site.yaml other.yaml")
    begun.inside("listener", script.format("its own token"))
    for service in ("talker", "listener"):
        assert begun.run("cp", f"{service}:/halls/.", str(maps)).code == 0
    for name in ("hall.yaml", "other.yaml"):
        sent = begun.run("cp", str(maps / name), "talker:/tmp/sent.yaml")
        assert sent.code == 0 and begun.inside("talker", "cat /tmp/sent.yaml") == "decoy\n", sent
    assert (maps / "site.yaml").read_text() == "its own token\n"


def test_no_container_puts_variables_beside_the_inventory(begun: Begun, tmp_path: Path) -> None:
    """A robot's variables may name a program, which the next verb would run here, as whoever has the robots' keys."""
    ran = tmp_path / "ran"
    command = f"ansible_ssh_common_args: -o ProxyCommand='touch {ran}'"
    begun.inside("talker", f'mkdir -p /vars/group_vars && echo "{command}" >/vars/group_vars/all.yml')
    copied = begun.run("cp", "talker:/vars/.", str(begun.folder))
    status = begun.run("status")
    shutil.rmtree(begun.folder / "group_vars", ignore_errors=True)
    assert copied.code == 5 and "could name programs there" in copied.err, copied
    assert status.code == 0 and not ran.exists(), status
    assert begun.run("cp", "talker:/vars/.", str(tmp_path / "new")).code == 0
    assert (tmp_path / "new/group_vars/all.yml").read_text() == f"{command}\n"


def test_no_container_puts_definitions_in_the_place_of_the_experiment_s(begun: Begun, tmp_path: Path) -> None:
    """What runs on other robots, with their secrets, would be what this one's container says."""
    name = yaml.safe_load((begun.folder / "experiment.edf").read_text())["name"]
    (tmp_path / "nav").mkdir()
    (tmp_path / "nav/nav.cdf").write_text("cdf: 1\nname: nav\nbase: busybox\ncommand: nav\n")
    text = f"edf: 1\nname: {name}\nservices: {{talker: {{cdf: nav/nav.cdf, environment: [SET_FOR_APPLY_ALONE]}}}}\n"
    (tmp_path / "e.edf").write_text(text)
    begun.inside("talker", "mkdir -p /config && cd /config && touch nav.cdf params.yaml")
    command = ("cp", str(tmp_path / "e.edf"), "-i", begun.inventory, f"talker@{begun.robot('talker')}:/config/.")
    copied = begun.lab.srprov(*command, str(tmp_path / "nav"))
    assert copied.code == 5 and "nav.cdf: what a container has could name programs there" in copied.err, copied
    assert begun.lab.srprov(*command, str(tmp_path / "nav/config")).code == 0
    (tmp_path / "e.edf").write_text(text.replace("cdf: nav", "wrong: 1, cdf: nav"))
    for place in ("nav", "new"):
        copied = begun.lab.srprov(*command, str(tmp_path / place))
        told = "so nothing is copied into its folder, until `srprov validate` takes it"
        assert copied.code == 5 and told in copied.err, copied
    assert (tmp_path / "nav/nav.cdf").stat().st_size


def test_a_copy_that_is_interrupted_leaves_no_half_file(begun: Begun, tmp_path: Path) -> None:
    begun.inside("talker", "truncate -s 4G /large")  # takes no room there
    (tmp_path / "large").write_text("before")
    copy = begin(begun.lab, "cp", *begun.words, "talker:/large", str(tmp_path))

    def comes() -> bool:
        return any(one.name.endswith(".part") and one.stat().st_size > 1 << 20 for one in tmp_path.iterdir())

    wait_until(comes, 60, "a part of it is here")
    copy.send_signal(signal.SIGINT)
    _, said = copy.communicate(timeout=60)
    assert copy.returncode == 130 and "Traceback" not in said, said
    assert os.listdir(tmp_path) == ["large"] and (tmp_path / "large").read_text() == "before"


def test_what_cannot_be_copied_is_told(begun: Begun, tmp_path: Path) -> None:
    cases = {
        ("talker:/nothing", str(tmp_path)): (5, "there is no /nothing in talker"),
        ("nobody:/x", str(tmp_path)): (5, "my-first has no nobody on these robots"),
        (str(tmp_path / "none"), "talker:/out"): (5, "there is no such file or folder"),
        ("talker:/out", "talker:/x"): (5, "the other is here"),
        ("talker:/out", str(tmp_path / "no/where")): (5, "there is no such folder"),
        (str(tmp_path), "talker:/out/word.txt"): (5, "is a file, and"),
    }
    for words, (code, said) in cases.items():
        done = begun.run("cp", *words)
        assert (done.code, said in done.err) == (code, True), done
    assert list(tmp_path.iterdir()) == []


def test_a_login_passes_words_streams_and_the_exit_code_on(begun: Begun) -> None:
    """As `exec` does: no shell takes a word apart, and output and errors are two streams."""
    lab, words = begun.lab, ("it's; $(reboot)", "two  blanks", "", "*", "ä\n")
    ssh = ("ssh", "robot1", "-i", begun.inventory)
    script = 'printf "%s|" "$@" "$(hostname)"; cat; echo on the other >&2; exit 7'
    done = lab.srprov(*ssh, "--", "sh", "-c", script, "sh", *words, stdin="given")
    host = lab.shell("robot1", "hostname").out.strip()
    assert done.code == 7 and done.out == "|".join([*words, host, ""]) + "given", done
    assert done.err == "on the other\n"
    shell = lab.srprov(*ssh, stdin="echo $((40 + 2)) of $(id -u)\nexit 3\n")
    assert (shell.code, shell.out) == (3, "42 of 0\n"), shell
    killed = lab.srprov(*ssh, "--", "sh", "-c", "kill -9 $$")
    assert killed.code == 255 and "a signal ended it" in killed.err, killed


def test_a_login_has_the_terminal(begun: Begun) -> None:
    """Its size, also when that changes; Ctrl-C ends what runs there, not the login."""
    there = Terminal(begun.lab, "ssh", "robot1", "-i", begun.inventory)
    there.says("stty size\n", "30 100")
    there.size(40, 120)
    there.says("stty size\n", "40 120")
    there.says("echo it be''gins; sleep 1000\n", "it begins")
    # a shell that is about to start it may take the first Ctrl-C for its own prompt
    there.says("\x03echo still $((40 + 2))\n", "still 42")
    os.write(there.end, b"exit 5\n")
    assert there.run.wait(timeout=120) == 5
    os.close(there.end)


def test_a_login_has_the_rules_of_every_connection(begun: Begun, tmp_path: Path) -> None:
    """A robot whose key nobody knows is refused, and so is a name that is none."""
    whole = yaml.safe_load(Path(begun.inventory).read_text())
    strange = tmp_path / "inventory.yml"
    (tmp_path / "known").write_text("")
    options = f"-o UserKnownHostsFile={tmp_path}/known -o GlobalKnownHostsFile=none -o StrictHostKeyChecking=yes"
    host = {**whole["all"]["hosts"]["robot1"], "ansible_ssh_common_args": options}
    more = {key: value for key, value in whole["all"].get("vars", {}).items() if "args" not in key}
    strange.write_text(yaml.safe_dump({"all": {"hosts": {"robot1": host}, "vars": more}}))
    refused = begun.lab.srprov("ssh", "robot1", "-i", str(strange), "--", "true")
    assert refused.code == 255 and "host key" in refused.err, refused
    unknown = begun.lab.srprov("ssh", "robot3", "-i", begun.inventory, "--", "true")
    assert unknown.code == 255 and "the inventory has no robot robot3" in unknown.err, unknown
