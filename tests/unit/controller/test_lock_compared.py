"""Nothing of a file elsewhere is hashed, or told, because a lock is to be compared with it, before that is allowed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.controller import pins
from srprov.controller.source import read_definitions
from srprov.errors import RefusedError, UsageError

LOCK = "lock: 1\nsrprov: '1'\nimages: []\nrepositories: []\nfiles:\n"
GUESS = "1" * 64


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    work, here = tmp_path / "victim/work", tmp_path / "project"
    (work / "clients").mkdir(parents=True)
    here.mkdir()
    monkeypatch.chdir(here)
    (work / "Dockerfile").write_text("FROM registry.example/acme-secret:1\nCOPY . /\n")
    (work / "clients/acme-merger.txt").write_text("x")
    (work / "private.bin").write_text("hunter2")
    Path("f.json").write_text('{"robots": {}}')
    Path("r.ini").write_text("r1 ansible_host=127.0.0.1\n")
    return here


def experiment(here: Path, service: str, *files: str) -> None:
    (here / "e.edf").write_text(f"edf: 1\nname: a\nservices:\n  x: {{{service}}}\n")
    (here / "e.lock").write_text(LOCK + "".join(f"  {one}: {GUESS}\n" for one in files))


@pytest.mark.parametrize("verb", ["plan e.edf -i r.ini", "apply e.edf -i r.ini -y", "build e.edf -i r.ini -y",
                                  "build e.edf --show", "run e.edf -i r.ini -y"])  # fmt: skip
def test_a_projects_own_settings_make_no_verb_tell_files_elsewhere(
    project: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    experiment(project, f"cdf: {project.parent}/victim/work/Dockerfile", "../victim/work/private.bin")
    (project / "srprov.toml").write_text("locked = true\n")
    assert run(verb.split()) != 0
    told = "".join(capsys.readouterr())
    assert "--allow outside" in told
    assert not [word for word in ("merger", "acme", "private.bin", "has changed") if word in told]


@pytest.mark.parametrize("locked", [True, False])
@pytest.mark.parametrize(
    "service", ["image: busybox, data: [{path: d.bin, target: /d}]", "image: busybox, volumes: ['./in:/v']"]
)
def test_no_guessed_hash_of_a_file_with_a_second_name_is_confirmed(
    project: Path, monkeypatch: pytest.MonkeyPatch, service: str, locked: bool
) -> None:
    (project / "in").mkdir()
    for name in ("d.bin", "in/d.bin"):
        os.link(project.parent / "victim/work/private.bin", project / name)
    experiment(project, service, "d.bin", "in/d.bin")
    hashed: list[object] = []
    monkeypatch.setattr(pins, "file_hashes", lambda *_: hashed.append(1) or {})
    with pytest.raises(RefusedError, match="outside"):
        read_definitions("e.edf", (), locked=locked)
    assert not hashed
    monkeypatch.undo()
    monkeypatch.chdir(project)
    with pytest.raises(UsageError, match="has changed"):
        read_definitions("e.edf", ["outside"], locked=True)


def test_what_is_the_experiments_own_is_compared_without_a_word(project: Path) -> None:
    experiment(project, "image: busybox", "e.edf")
    with pytest.raises(UsageError, match=r"the file e\.edf has changed"):
        read_definitions("e.edf", (), locked=True)
