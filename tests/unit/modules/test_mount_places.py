"""Mounts below a volume: a link in the volume's data leads none of them elsewhere."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from srprov.modules.mount_places import places_refused

DOCKER = """#!/bin/sh
for last; do :; done
case $1 in
  volume) if [ -d "{0}/data/$last" ]; then echo "{0}/data/$last"; else cat "{0}/why" >&2; exit 1; fi ;;
  ps) [ ! -e "{0}/away" ] || exit 1; [ ! -e "{0}/${{last#volume=}}.writers" ] || echo 0123456789ab ;;
  inspect) [ ! -e "{0}/inspect-fails" ] || exit 1; cat "{0}"/*.writers ;;
esac
"""
OWN = "srprov.x.planner"


def volume(name: str, target: str) -> dict[str, Any]:
    return {"Type": "volume", "Source": name, "Target": target}


def bind(target: str) -> dict[str, Any]:
    return {"Type": "bind", "Source": "/var/lib/srprov/x", "Target": target, "ReadOnly": True}


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where volumes lie, for a program that says so as Docker's does."""
    program = tmp_path / "bin" / "docker"
    program.parent.mkdir()
    program.write_text(DOCKER.format(tmp_path))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
    (tmp_path / "data").mkdir()
    (tmp_path / "why").write_text("Error response from daemon: get v: no such volume\n")
    return tmp_path / "data"


def said(*mounts: dict[str, Any]) -> str:
    done = subprocess.run(["sh", "-c", places_refused(OWN, mounts)], capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1) and bool(done.stderr) == bool(done.returncode)
    return done.stderr


@pytest.mark.parametrize(
    "mounts",
    [
        (volume("v", "/data"), volume("w", "/data/logs")),
        (volume("v", "/data"), bind("/data/logs/deep/x.yml")),
        (volume("v", "//data/"), {"Type": "tmpfs", "Target": "/data/./logs"}),
        (bind("/data"), volume("v", "/data/b"), volume("u", "/data/b/c"), volume("w", "/data/b/logs")),
    ],
)
@pytest.mark.parametrize("link", ["/bin", "elsewhere", "/nowhere"])
def test_a_link_where_a_mount_goes_is_refused(data: Path, mounts: tuple[dict[str, Any], ...], link: str) -> None:
    (data / "v").mkdir()
    (data / "v" / "elsewhere").mkdir()
    assert said(*mounts) == "", "what is not there is made"
    (data / "v" / "logs").symlink_to(link)
    assert said(*mounts).startswith("logs in the volume v is a link"), mounts


def test_each_part_of_the_way_is_looked_at(data: Path) -> None:
    (data / "v" / "a").mkdir(parents=True)
    (data / "v" / "a" / "-n b").symlink_to("/etc")
    assert said(volume("v", "/d"), volume("w", "/d/a/-n b/c")).startswith("a/-n b in the volume v is a link")
    assert said(volume("v", "/d"), volume("w", "/d/a/c")) == ""


def test_links_of_the_data_that_no_mount_goes_by_are_its_own(data: Path) -> None:
    """A volume that another one lies over is asked only for the way to that one."""
    (data / "v" / "logs").mkdir(parents=True)
    (data / "v" / "latest").symlink_to("logs")
    (data / "v" / "logs" / "x").symlink_to("/etc")
    (data / "w").mkdir()
    assert said(volume("v", "/d"), volume("w", "/d/logs"), bind("/d/logs/x")) == ""


@pytest.mark.parametrize(
    "mounts", [(), (volume("v", "/d"),), (volume("v", "/d"), bind("/dx/y")), (bind("/d"), volume("v", "/d/x"))]
)
def test_nothing_is_asked_where_no_mount_is_below_a_volume(mounts: tuple[dict[str, Any], ...]) -> None:
    assert places_refused(OWN, mounts) == ""


def test_a_volume_that_is_not_there_has_no_data(data: Path) -> None:
    assert not (data / "v").exists()
    assert said(volume("v", "/d"), volume("w", "/d/x")) == ""


@pytest.mark.parametrize(
    ("writers", "refused"), [(f"/{OWN}", ""), (f"/{OWN} /srprov.x.cam", "srprov.x.cam"), ("/a", "a")]
)
def test_nobody_else_who_runs_may_put_a_link_there(data: Path, writers: str, refused: str) -> None:
    """One that is stopped is made anew, or gone, before it could."""
    (data.parent / "v.writers").write_text(writers)
    words = said(volume("v", "/data"), volume("w", "/data/logs"))
    assert words.startswith(f"{refused} may write to the volume v") if refused else words == ""
    assert said(volume("u", "/data"), volume("w", "/data/logs")) == said(volume("v", "/data")) == ""


def test_what_docker_does_not_tell_is_refused(data: Path) -> None:
    (data.parent / "why").write_text("Cannot connect to the Docker daemon\n")
    assert said(volume("v", "/d"), volume("w", "/d/x")).startswith("what lies in the volume v cannot be told")
    (data / "v").mkdir()
    assert said(volume("v", "/d"), volume("w", "/d/x")) == ""
    (data.parent / "v.writers").write_text("/a")
    (data.parent / "inspect-fails").touch()
    assert said(volume("v", "/d"), volume("w", "/d/x")).startswith("who writes to the volume v cannot be told")
    (data.parent / "away").touch()
    assert said(volume("v", "/d"), volume("w", "/d/x")).startswith("who writes to the volume v cannot be told")
