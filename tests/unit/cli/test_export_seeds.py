"""A volume with a seed is a folder of the export: what a container leaves there lies among the user's own files."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from srprov.cli.main import run
from srprov.controller.compose import read
from srprov.definitions.containermodel import Mount, Seed
from srprov.exporting.model import Machine, Part
from srprov.exporting.mounts import Shipping
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from tests.unit.exporting.exports import document, twin

EDF = """\
edf: 1
name: demo
volumes: {maps: {seed: ./maps}}
services:
  planner: {image: busybox, volumes: ["maps:/maps"]}
  viewer: {image: busybox, volumes: ["maps:/maps:ro"]}
"""
WHAT = (
    "./volumes/maps of the export, a folder of whoever runs it, writable (may be as good as root there, where a "
    "program of anybody's runs, follows or believes what is left in it)"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a stranger's folder with an EDF, as the current one."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a.pgm").write_text("P5")
    (tmp_path / "e.edf").write_text(EDF)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    return tmp_path


def test_a_folder_of_the_user_is_lent_to_no_container_unasked(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A `.git` in it ran a program at the next `git status`, and `scp -r` followed a link to the user's keys."""
    order = ["export", "compose", "e.edf", "-o", "out"]
    for allowed in ((), ("--allow", "outside"), ("--allow", "docker-socket")):
        assert run([*order, *allowed]) == 9
        said = capsys.readouterr().err
        assert f"planner: host-path ({WHAT})" in said and said.count("host-path (") == 1, said
        assert "--allow host-path" in said and "`:ro`" in said and "`apply`" in said
        assert not (folder / "out").exists()
    assert run([*order, "--allow", "host-path"]) == 0
    note = f"planner gets more than its container, and Compose asks nobody: host-path ({WHAT})"
    assert f"note: {note}\n" in capsys.readouterr().err
    assert note in (folder / "out" / "README.md").read_text().replace("\\", "")
    (folder / "settings" / "srprov").mkdir(parents=True)
    (folder / "settings" / "srprov" / "policy.yml").write_text("policy: 1\nallow: {all: [outside]}\n")
    assert run(["export", "compose", "e.edf", "-o", "again", "--allow", "host-path"]) == 9
    assert not (folder / "again").exists()


def test_a_seed_that_is_only_read_is_not_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "e.edf").write_text(EDF.replace('"maps:/maps"', '"maps:/maps:ro"'))
    assert run(["export", "compose", "e.edf", "-o", "out"]) == 0
    assert "host-path" not in capsys.readouterr().err
    readme = (folder / "out" / "README.md").read_text()
    assert "containers write to" not in readme and "host-path" not in readme
    assert (folder / "out" / "volumes" / "maps" / "a.pgm").read_text() == "P5"


def test_a_plan_lends_no_folder_unasked_either(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = Plan(instance="demo", source="lab@desk:e.edf", steps=(), assignment={"planner": "r1", "viewer": "r1"})
    saved = PlanFile(plan=plan, fingerprints={"r1": {}}, inputs={"e.edf": (folder / "e.edf").read_text()})
    (folder / "p.json").write_text(dump(saved))
    assert run(["export", "compose", "p.json", "-o", "out"]) == 9
    assert f"planner: host-path ({WHAT.replace('./', './r1/')})" in capsys.readouterr().err
    assert not (folder / "out").exists()
    assert run(["export", "compose", "p.json", "-o", "out", "--allow", "host-path"]) == 0
    assert (folder / "out" / "r1" / "volumes" / "maps" / "a.pgm").read_text() == "P5"


def test_the_readme_says_what_may_lie_there_and_finds_it(folder: Path) -> None:
    """The order that it has for it is run here, on what a container would leave."""
    assert run(["export", "compose", "e.edf", "-o", "out", "--allow", "host-path"]) == 0
    told = (folder / "out" / "README.md").read_text()
    assert "- `volumes/maps`: planner\n" in told and "`git status`" in told and "`scp -r`" in told
    look = next(line.strip() for line in told.splitlines() if line.startswith("    find "))
    left = folder / "out" / "volumes" / "maps"
    assert subprocess.run(look, shell=True, cwd=folder / "out", capture_output=True, check=True).stdout == b""
    (left / "plain").mkdir()
    (left / "plain" / "b.pgm").write_text("P5")
    (left / "notes.txt").symlink_to("/etc/passwd")
    (left / "tool").write_text("#!/bin/sh\n")
    (left / "tool").chmod(0o4755)
    (left / "a" / ".git").mkdir(parents=True)
    (left / "bare").mkdir()
    (left / "bare" / "HEAD").write_text("ref: refs/heads/main\n")
    (left / "_darcs").mkdir()
    os.mkfifo(left / "pipe")
    (left / "hard").hardlink_to(left / "plain" / "b.pgm")
    found = subprocess.run(look, shell=True, cwd=folder / "out", capture_output=True, check=True, text=True).stdout
    names = {re.sub("^./volumes/maps/", "", line) for line in found.splitlines()}
    assert names == {"notes.txt", "tool", "a/.git", "bare/HEAD", "_darcs", "pipe", "hard", "plain/b.pgm"}


@pytest.mark.parametrize(
    "mount",
    [
        Mount(kind="volume", source="maps", target="/m", seed=Seed(path="/maps")),
        Mount(kind="volume", source="maps", target="/m", seed=Seed(path="/maps", user="1000")),
        Mount(kind="tree", source="/x", target="/m"),
        Mount(kind="data", source="/x", target="/m"),
        Mount(kind="data", source="", target="/m", url="https://x.example/x", sha256="ab" * 32),
    ],
)
def test_nothing_of_an_export_can_be_written_to_that_is_not_asked_for(folder: Path, mount: Mount) -> None:
    """Whatever is mounted of it: what is shipped is read-only, and all else is told."""
    experiment = read("e.edf", frozenset()).definitions.experiment
    ships = Shipping(experiment=experiment, machine=Machine(robot="", services=()), shipped=lambda _: ())
    service = experiment.services["planner"]
    for one in (mount, replace(mount, read_only=True)):
        with_it = replace(service, runtime=replace(service.runtime, mounts=(one,)))
        made: Part = ships.mounts(with_it)
        (volume,) = msgspec.convert(made.document["volumes"], list[dict[str, object]])
        assert str(volume["source"]).startswith("./")
        assert bool(volume.get("read_only")) == (not made.lent), volume


def test_what_asks_for_nothing_has_no_folder_of_the_export_that_can_be_written_to(folder: Path) -> None:
    (folder / "e.edf").write_text(EDF.replace('"maps:/maps"', '"maps:/maps:ro", "./maps:/own", "logs:/logs"'))
    mounts = [one for each in document(twin(folder / "e.edf"))["services"].values() for one in each["volumes"]]
    assert [one["source"] for one in mounts if not one.get("read_only")] == ["logs"]
