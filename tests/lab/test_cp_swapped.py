"""A container swaps folders for links to its robot's own while `cp` reads and writes: nothing is mounted there."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from srprov.lab.robot import enter
from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

TIMES = 8
SWAP = """
import ctypes, os, sys
exchange = ctypes.CDLL(None, use_errno=True).renameat2
os.chroot(f"/proc/{sys.argv[1]}/root")
os.chdir("/")
while True:
    assert exchange(-100, b"/m/a", -100, b"/m/out", 2) == 0, ctypes.get_errno()
"""
"""A folder with a volume in it, and a link in its place, again and again, as the container's own root may do it."""
WATCH = """
import time
seen = set()
while True:
    with open("/proc/1/mountinfo") as file:
        now = {line.split()[4] for line in file}
    for one in sorted(now - seen):
        print(one, flush=True)
    seen |= now
    time.sleep(0.001)
"""
ENGINES_OWN = ("/var/lib/docker/", "/run/docker/")


@contextmanager
def running(lab: Lab, *words: str, out: Path) -> Iterator[None]:
    """Run a program on the robot meanwhile."""
    with out.open("wb") as file:
        ran = subprocess.Popen(enter(lab.site, "robot1", words), stdout=file, stderr=subprocess.STDOUT)
        try:
            yield
            assert ran.poll() is None, out.read_text()
        finally:
            ran.kill()
            ran.wait()


def mounted(lab: Lab) -> set[str]:
    """Give where the robot has something mounted, but for what its engine mounts in its own folders."""
    points = lab.shell("robot1", "cut", "-d", " ", "-f", "5", "/proc/1/mountinfo").out.splitlines()
    return {one for one in points if not one.startswith(ENGINES_OWN)}


def test_nothing_is_mounted_where_a_container_leads_meanwhile(lab: Lab, tmp_path: Path) -> None:
    """Docker 20.10 mounted the volume over the robot's /usr/local/bin."""
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    begin = "ln -s /usr/local /m/out; echo file >/w; exec sleep 86400"
    path.write_text(edf("swapped", {"a": busybox("sh", "-c", begin, volumes=["data:/m/a/bin"], robot="robot1")}))
    words = (str(path), "-i", inventory)
    (tmp_path / "in/deep").mkdir(parents=True)
    (tmp_path / "in/deep/word").write_text("word" * 10_000)
    assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
    before, pid = mounted(lab), str(lab.inspect("robot1", "srprov.swapped.a")["State"]["Pid"])
    watched, done = tmp_path / "watched", list[Done]()
    try:
        with (
            running(lab, "python3", "-c", WATCH, out=watched),
            running(lab, "python3", "-c", SWAP, pid, out=tmp_path / "swapping"),
        ):
            for time in range(TIMES):
                sent = lab.srprov("cp", *words, str(tmp_path / "in"), "a:/m/a/bin/")
                back = lab.srprov("cp", *words, "a:/m/a/bin/in", str(tmp_path / f"back{time}"))
                file = lab.srprov("cp", *words, "a:/w", str(tmp_path / f"w{time}"))
                done += [sent, back, file]
    finally:
        after = mounted(lab)
        for one in sorted(after - before, key=len, reverse=True):
            lab.shell("robot1", "umount", "-l", one)
        lab.srprov("destroy", *words, "--yes", "--volumes")
    seen = {one for one in watched.read_text().splitlines() if not one.startswith(ENGINES_OWN)}
    assert (seen - before, after - before) == (set(), set())
    assert [one for one in done if one.code] == []
    for time in range(TIMES):
        assert (tmp_path / f"back{time}/deep/word").read_text() == "word" * 10_000
        assert (tmp_path / f"w{time}").read_text() == "file\n"
