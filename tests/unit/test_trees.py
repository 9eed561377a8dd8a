"""Folders are removed however deep they lie in each other, with no link followed."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov import trees
from srprov.lab import disk


def deep(folder: Path, name: str = "a") -> None:
    """Make a thousand and four hundred folders in each other, with a file in each."""
    folder.mkdir()
    here = os.open(folder, os.O_RDONLY)
    for _ in range(1400):
        os.close(os.open("x", os.O_WRONLY | os.O_CREAT, dir_fd=here))
        for one in (name, "beside"):
            os.mkdir(one, dir_fd=here)
        there = os.open(name, os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = there
    os.close(here)


@pytest.mark.parametrize("name", ["a", "long" * 10])
def test_a_tree_is_removed_however_deep_it_is(tmp_path: Path, name: str) -> None:
    """A path to its end may be longer than the kernel takes."""
    deep(tmp_path / "top", name)
    trees.remove(tmp_path / "top")
    assert os.listdir(tmp_path) == []


def test_no_link_is_followed_and_nothing_else_is_touched(tmp_path: Path) -> None:
    outside, top = tmp_path / "outside", tmp_path / "top"
    for one in (outside, top, top / "in"):
        one.mkdir()
    (outside / "kept").write_text("x")
    (top / "in/link").symlink_to(outside)
    (top / "in/none").symlink_to("nowhere")
    os.mkfifo(top / "pipe")
    (tmp_path / "link").symlink_to(outside)
    for one in (top, tmp_path / "link", tmp_path / "missing", tmp_path / "missing/x", outside / "kept"):
        trees.remove(one)
    assert sorted(os.listdir(tmp_path)) == ["link", "outside"] and os.listdir(outside) == ["kept"]


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to mount something")
def test_what_cannot_be_removed_stays_alone(tmp_path: Path) -> None:
    held = tmp_path / "top/in/held"
    held.mkdir(parents=True)
    (tmp_path / "top/in/beside").mkdir()
    (tmp_path / "top/file").write_text("x")
    subprocess.run(["mount", "-t", "tmpfs", "test", held], check=True)
    try:
        trees.remove(tmp_path / "top")
        assert [str(one.relative_to(tmp_path)) for one in sorted(tmp_path.rglob("*"))] == [
            "top",
            "top/in",
            "top/in/held",
        ]
    finally:
        subprocess.run(["umount", held], check=True)


def test_the_disk_of_a_lab_s_robot_goes_whatever_its_containers_made(tmp_path: Path) -> None:
    deep(tmp_path / "r1")
    site: Any = SimpleNamespace(disk=lambda name: tmp_path / name)
    disk.remove(site, "r1")
    assert os.listdir(tmp_path) == []
