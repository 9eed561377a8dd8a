"""A thousand folders in each other, which functions of Python call themselves for, end nothing; nor do many files."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov import regular_file
from srprov.cli.main import run
from srprov.conversion.tree import Tree
from srprov.evidence import files
from srprov.exporting.folder import write
from srprov.exporting.model import File
from tests.bounded import bounded

EDF = "edf: 1\nname: a\nservices: {s: {image: busybox, volumes: ['./deep:/x']}}\n"
COMPOSE = "services: {s: {image: busybox, volumes: ['./deep:/x']}}\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that is removed by a program: Python's own function calls itself, too."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    subprocess.run(["rm", "-rf", "--", str(tmp_path)], check=True)


def deepen(folder: Path, times: int = 1200) -> None:
    """Put so many folders in each other, and a file into the last one."""
    folder.mkdir(parents=True)
    before = os.getcwd()
    os.chdir(folder)
    for _ in range(times):
        os.mkdir("d")
        os.chdir("d")
    Path("f").write_text("x")
    os.chdir(before)


def test_all_below_a_folder_is_told_as_python_does(here: Path) -> None:
    (here / "a" / "b").mkdir(parents=True)
    (here / "a" / "c").write_text("x")
    (here / "a" / "loop").symlink_to("loop")
    (here / "link").symlink_to("a")
    assert sorted(regular_file.walk(here)) == sorted(os.walk(here))
    deepen(here / "deep", 1500)
    assert sum("f" in found for _, _, found in regular_file.walk(here / "deep")) == 1


def test_a_page_of_a_run_with_deep_folders_is_made(here: Path) -> None:
    deepen(here / "run" / "inputs")
    (here / "run" / "environment.json").write_text('{"verb": "apply"}')
    assert run(["report", "run", "-o", "page.html"]) == 0
    deepen(here / "trials" / "sessions")
    assert len(files.of_run(here / "trials").sizes) == 1


def test_deep_folders_are_looked_through_for_definitions(here: Path) -> None:
    deepen(here / "deep")
    Path("a.edf").write_text("edf: 1\nname: a\nservices: {s: {image: busybox}}\n")
    assert run(["fmt", "--check", "."]) in (0, 2)
    assert run(["validate", "."]) == 0
    deepen(here / "host_vars" / "r1")
    Path("inv.ini").write_text("r1 ansible_host=127.0.0.1\n")
    assert run(["validate", "inv.ini"]) in (0, 5)


def test_deep_folders_are_neither_shipped_nor_imported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deepen(here / "deep")
    Path("a.edf").write_text(EDF)
    Path("compose.yaml").write_text(COMPOSE)
    assert run(["validate", "a.edf"]) == 5
    assert "holds more than 50 folders in each other" in capsys.readouterr().out
    assert run(["import", "compose", "compose.yaml", "-o", "out"]) == 5
    assert "more than 50 folders lie in each other" in capsys.readouterr().err
    assert not (here / "out").exists()


def test_many_files_of_one_deep_folder_are_written_in_time(here: Path) -> None:
    """Each looked at all folders above it: minutes for what is a few kilobytes as an archive."""
    place = "d/" * 100
    (here / "made").mkdir()

    def fill() -> None:
        tree = Tree(str(here / "made"))
        for at in range(4000):
            tree.write(f"{place}{at}", b"")

    bounded(fill)
    bounded(lambda: write("out", [File(path=f"{place}{at}", content=b"") for at in range(4000)]))
    assert len(os.listdir(f"made/{place}")) == len(os.listdir(f"out/{place}")) == 4000
