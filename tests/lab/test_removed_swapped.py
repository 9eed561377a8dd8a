"""Somebody holds a folder of what is removed, and swaps folders in it for links: nothing of the robot is emptied."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from srprov.lab.robot import enter
from tests.lab.conftest import Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

TIMES = 2
HOLD = """
import ctypes, os, sys, time
swap = ctypes.CDLL(None, use_errno=True).renameat2
held = os.open(f"/proc/{sys.argv[1]}/root{sys.argv[2]}", os.O_RDONLY | os.O_DIRECTORY)
for number in range(1500):
    os.mkdir(f"e{number}", dir_fd=held)
    for name in "abc":
        os.close(os.open(f"e{number}/{name}", os.O_CREAT | os.O_WRONLY, dir_fd=held))
with os.scandir(os.dup(held)) as found:
    names = [one.name.encode() for one in found]
os.symlink("/srv/led", "link", dir_fd=held)
link, at, end = b"link", 0, time.monotonic() + 60
print("ready", flush=True)
while at < len(names) and time.monotonic() < end:
    if swap(held, names[at], held, link, 2):
        at, link = at + 1, b"link%d" % at
        try:
            os.symlink("/srv/led", link, dir_fd=held)
        except OSError:
            break
"""
"""Swaps, again and again, as who was handed that folder, open, may do it; until the names in it are gone."""


@contextmanager
def holding(lab: Lab, pid: str, folder: str) -> Iterator[None]:
    """Hold a folder of a container meanwhile, until a while after it was removed."""
    words = enter(lab.site, "robot1", ["python3", "-c", HOLD, pid, folder])
    holder = subprocess.Popen(words, stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None and holder.stdout.readline() == b"ready\n"
        yield
        assert holder.poll() in (None, 0)
    finally:
        holder.kill()
        holder.wait()


def test_an_engine_is_led_nowhere_while_it_removes(lab: Lab, tmp_path: Path) -> None:
    """Docker 20.10 emptied the folder of the robot that the links led to; a holder may be in the way for a while."""
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    begin = "mkdir /own /v/own; exec sleep 86400"
    service = busybox("sh", "-c", begin, volumes=["v:/v"])
    path.write_text(edf("removed", {"a": service}), encoding="utf-8")
    words = (str(path), "-i", inventory)
    lab.shell("robot1", "mkdir", "-p", "/srv/led/below")
    lab.shell("robot1", "touch", "/srv/led/file", "/srv/led/below/file")
    try:
        for _ in range(TIMES):
            assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
            pid = str(lab.inspect("robot1", "srprov.removed.a")["State"]["Pid"])
            with holding(lab, pid, "/own"), holding(lab, pid, "/v/own"):
                done = lab.srprov("destroy", *words, "--yes", "--volumes")
            there = lab.shell("robot1", "find", "/srv/led", "-type", "f").out
            assert there.split() == ["/srv/led/file", "/srv/led/below/file"], there
            assert done.code == 0 or "a container that still runs may hold it open" in done.err, done
            done = lab.srprov("destroy", *words, "--yes", "--volumes")
            assert done.code == 0, done
            left = "docker ps -a; docker volume ls; ls /var/lib/docker/volumes"
            assert "srprov" not in lab.shell("robot1", "sh", "-c", left).out
    finally:
        lab.srprov("destroy", *words, "--yes", "--volumes")
        lab.shell("robot1", "rm", "-rf", "/srv/led")
