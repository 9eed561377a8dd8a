"""Where the devices of new containers lead, and what a plan says of it."""

from __future__ import annotations

import os
import stat
import subprocess
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.device_links import graver_devices, led_to, where_they_lead
from srprov.controller.owners import read_owner
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, kept_plan
from srprov.definitions.model import Definitions
from srprov.planning.graver import HARMLESS
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from tests.fakes import World
from tests.worlds import experiment, fleet, made, plan_for, service

ROOT = "as good as root on the robot"


def having(*paths: str, **fields: Any) -> Any:
    return service("a", devices=tuple((path, path, "rwm") for path in paths), **fields)


@pytest.mark.parametrize(
    ("path", "real", "note"),
    [
        ("/dev/lidar", "/dev/uinput", f"may be {ROOT}"),
        ("/dev/teleop", "/dev/input/event4", f"may be {ROOT}"),
        ("/dev/ubuntu-vg/ubuntu-lv", "/dev/dm-0", f"a disk: {ROOT}, if it is the robot's own"),
        ("/dev/arm", "/srv/data/tty", "it may be any device"),
        ("/dev/lidar", "/dev/ttyUSB0", HARMLESS),  # of its name alone nobody knew that
        ("/dev/video0", "/dev/video1", ""),
        ("/dev/lidar", "/dev/lidar", ""),
        ("/dev/uinput", "/dev/hidraw0", f"may be {ROOT}"),
        ("/dev/sda", "/dev/hidraw0", ""),  # which was said
        ("/dev/lidar", "", ""),
        ("/dev/lidar", "dev/mem", ""),
    ],
)
def test_a_device_that_is_more_than_its_name_is_said_to_be(path: str, real: str, note: str) -> None:
    said = list(graver_devices([having("/dev/aa", path)], f"0 /dev/aa\n1 {real}\n"))
    assert said == ([f"the device {path}, which 'a' has, leads to {real} ({note})"] if note else [])


def test_a_disk_is_said_to_be_one_whatever_it_is_called() -> None:
    """Kernels have more kinds of them than any list: bcache, drbd, pmem."""
    disk = f"a disk: {ROOT}, if it is the robot's own"
    said = "0 /dev/bcache0\nb0 /dev/bcache0\n1 /dev/drbd1\nb1 /dev/drbd1\n2 /dev/sda\nb2 /dev/sda\n3 /dev/ttyUSB0\n"
    assert list(graver_devices([having("/dev/bcache0", "/dev/data", "/dev/sda", "/dev/usb")], said)) == [
        f"the device /dev/bcache0, which 'a' has, is, or holds, {disk}",
        f"the device /dev/data, which 'a' has, leads to /dev/drbd1 (it is, or holds, {disk})",
        f"the device /dev/usb, which 'a' has, leads to /dev/ttyUSB0 ({HARMLESS})",
    ]


def test_a_shell_says_which_are_disks(tmp_path: Path) -> None:
    """And which folders have some, as an engine takes all that is in one."""
    (tmp_path / "some").mkdir()
    os.mknod(tmp_path / "some" / "disk", stat.S_IFBLK | 0o600, os.makedev(240, 0))
    os.symlink("some/disk", tmp_path / "a")
    (tmp_path / "z").touch()
    query = where_they_lead([having(*(str(tmp_path / name) for name in ("a", "some", "z")))])
    out = subprocess.run(["sh", "-c", query.command], capture_output=True, text=True, check=True).stdout
    disk, folder, file = tmp_path / "some" / "disk", tmp_path / "some", tmp_path / "z"
    assert out.splitlines() == [f"0 {disk}", f"b0 {disk}", f"1 {folder}", f"b1 {folder}", f"2 {file}"]


def test_the_plan_says_so_of_each_robot_of_a_new_container() -> None:
    """A robot's own rules give devices their names: what its keys are typed on, too."""
    world = World().add("r1")
    world.robots["r1"].leads = "/dev/uinput"
    plan = plan_for(world, experiment(having("/dev/video0")))
    assert f"r1: the device /dev/video0, which 'a' has, leads to /dev/uinput (may be {ROOT})" in plan.notes


def test_a_shell_says_where_each_leads(tmp_path: Path) -> None:
    one, other = tmp_path / "it's one", tmp_path / "other"
    other.touch()
    os.symlink("other", one)
    query = where_they_lead([having(str(one), str(other), str(tmp_path / "gone"))])
    out = subprocess.run(["sh", "-c", query.command], capture_output=True, text=True, check=True).stdout
    assert out.splitlines() == [f"0 {tmp_path}/gone", f"1 {other}", f"2 {other}"]
    assert list(graver_devices([having(str(one), str(other))], f"0 {other}\n1 {other}\n")) == [
        f"the device {one}, which 'a' has, leads to {other} (it may be any device)"
    ]
    assert where_they_lead([service("b")]).command == ":"


def test_a_plan_file_of_elsewhere_is_shown_with_it_whatever_its_notes_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever wrote the file wrote its notes; so with the robot's folders."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    world = World().add("r1")
    world.robots["r1"].leads = "/dev/uinput"
    what = experiment(having("/dev/video0"))
    request = PlanRequest(exact=True, adopt=True, owner=read_owner(what.name, what.file))
    planned = made(world, Definitions(experiment=what, containers={}), request)
    saved = load(dump(kept_plan(replace(planned, definitions=None))), "plan.json")
    note = f"r1: the device /dev/video0, which 'a' has, leads to /dev/uinput (may be {ROOT})"
    assert saved.plan.notes.count(note) == check_plan(saved, fleet(world)).plan.notes.count(note) == 1
    for notes in ((), saved.plan.notes):
        other = replace(saved, plan=replace(saved.plan, notes=notes), proof="")
        assert check_plan(other, fleet(world), adopt=True).plan.notes.count(note) == 1


def test_a_long_way_is_not_cut_before_it_is_looked_at() -> None:
    """Cut off in the middle, it was another path than the one that the robot checks when the container is made."""
    deep = "/srv/data/" + "x" * 300
    assert led_to(f"0 {deep}\n1 relative\n") == {"0": deep, "1": "", "": ""}
