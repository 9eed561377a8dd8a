"""Other people on the controller: they can read nothing that a run leaves there, and a crash leaves no memory."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from srprov import private

ROOT = Path(__file__).parents[3]
VALUE = "key-of-the-cloud"
EDF = """\
edf: 1
name: demo
secrets:
  token: {command: [sh, -c, "(ulimit -c; ulimit -Hc) > limits; echo token-of-the-lab"]}
services:
  a: {image: busybox, secrets: [token], environment: [CLOUD_KEY]}
"""
ALLOWED = ("--allow", "secret-command", "--allow", "env")


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """Return a folder with an experiment, where an earlier version left its folders open to all."""
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {ansible_host: 10.0.0.1}}}\n")
    for folder in (".local/state/srprov", ".cache/srprov"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder).chmod(0o755)
    (tmp_path / ".cache" / "srprov" / "documents").touch(0o644)
    return tmp_path


def srprov(here: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run one command line with robots in memory, by a user whose umask leaves everything open."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "HOME": str(here), "CLOUD_KEY": VALUE}
    env = {key: value for key, value in env.items() if not key.startswith(("XDG_", "SRPROV_"))}
    command = [sys.executable, "-m", "tests.unit.cli.faked", *words]
    return subprocess.run(
        command, cwd=here, env=env, text=True, capture_output=True, timeout=60, check=False, umask=0,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def open_to_others(*places: Path) -> list[str]:
    """Return every file and folder that somebody else has a right to."""
    every = [one for place in places for one in (place, *place.rglob("*"))]
    assert len(every) > len(places)
    return [f"{one} {stat.S_IMODE(one.stat().st_mode):o}" for one in every if one.stat().st_mode & 0o077]


def test_records_caches_and_events_are_the_users_alone(here: Path) -> None:
    (here / "e.edf").write_text(EDF.replace("secrets: [token], ", ""))  # robots in memory keep none
    done = srprov(here, "apply", "e.edf", "-i", "inv.yml", "--yes", "--settle", "0", "--events", "events", *ALLOWED)
    assert done.returncode == 0, done
    assert list((here / ".local/state/srprov/runs").iterdir())
    state, cache = here / ".local/state/srprov", here / ".cache/srprov"
    assert open_to_others(state, cache) == []
    assert stat.S_IMODE((here / "events").stat().st_mode) == 0o600
    recorded = "".join(one.read_text() for one in state.rglob("*") if one.is_file())
    assert "CLOUD_KEY=***" in recorded and VALUE not in recorded + done.stdout + done.stderr


def test_a_plan_file_is_the_users_alone_also_where_one_was(here: Path) -> None:
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    (here / "plan.json").touch(0o644)
    for name in ("plan.json", "new.json"):
        done = srprov(here, "plan", "e.edf", "-i", "inv.yml", "-o", name)
        assert done.returncode == 0, done
        assert stat.S_IMODE((here / name).stat().st_mode) == 0o600
    shown = srprov(here, "plan", "e.edf", "-i", "inv.yml", "-o", "/dev/stdout")
    assert '"format": 2' in shown.stdout


def test_a_variable_of_the_controller_goes_into_no_plan_file_and_no_output(here: Path) -> None:
    (here / "e.edf").write_text(EDF.replace("secrets: [token], ", ""))
    done = srprov(here, "plan", "e.edf", "-i", "inv.yml", "-v", "-o", "plan.json", *ALLOWED)
    assert done.returncode == 9, done
    assert "the value of the variable 'CLOUD_KEY' stands in the plan" in done.stderr
    assert not (here / "plan.json").exists()
    shown = srprov(here, "plan", "e.edf", "-i", "inv.yml", "-v", *ALLOWED)
    assert "CLOUD_KEY=***" in shown.stdout and VALUE not in shown.stdout + shown.stderr


def test_no_core_is_dumped_while_secrets_are_in_memory(here: Path) -> None:
    """A program that srprov starts has its limits: none is left to raise."""
    assert srprov(here, "plan", "e.edf", "-i", "inv.yml", *ALLOWED).returncode == 0
    assert (here / "limits").read_text().split() == ["0", "0"]


def test_folders_of_others_above_stay_as_they_are(tmp_path: Path) -> None:
    """Only what is missing is made, and only our own folder is narrowed."""
    tmp_path.chmod(0o755)
    private.make_folder(tmp_path / "state" / "srprov" / "runs")
    (tmp_path / "state" / "srprov").chmod(0o777)
    private.make_folder(tmp_path / "state" / "srprov" / "runs")
    modes = [stat.S_IMODE(one.stat().st_mode) for one in (tmp_path, tmp_path / "state", tmp_path / "state/srprov")]
    assert modes == [0o755, 0o700, 0o700]


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    """And nothing is left beside it, whatever stops the writing."""
    place = tmp_path / "new" / "file"
    for text in ("one", "two \udcff"):
        private.replace_file(place, text)
    assert place.read_text() == "two ?" and open_to_others(place.parent) == []
    (tmp_path / "folder" / "in the way").mkdir(parents=True)
    with pytest.raises(IsADirectoryError):
        private.replace_file(tmp_path / "folder", "three")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["folder", "new"]
    assert [one.name for one in place.parent.iterdir()] == ["file"]
