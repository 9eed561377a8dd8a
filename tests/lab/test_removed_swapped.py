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

HOLD = """
import ctypes, os, sys, time
swap = ctypes.CDLL(None, use_errno=True).renameat2
held = os.open(f"/proc/{sys.argv[1]}/root{sys.argv[2]}", os.O_RDONLY | os.O_DIRECTORY)
names = [f"e{number}" for number in range(15)]
for name in names:
    os.mkdir(name, dir_fd=held)
    for number in range(2500):
        os.close(os.open(f"{name}/{number}", os.O_CREAT | os.O_WRONLY, dir_fd=held))
    os.symlink("/srv/led", f"to-{name}", dir_fd=held)
print("ready", flush=True)

def entries(name):
    try:
        folder = os.open(name, os.O_RDONLY | os.O_DIRECTORY, dir_fd=held)
    except OSError:
        return -1
    try:
        return len(os.listdir(folder))
    except OSError:
        return -1
    finally:
        os.close(folder)

end = time.monotonic() + 60
while names and time.monotonic() < end:
    for name in names[:]:
        if (left := entries(name)) < 2500:
            names.remove(name)
            left > 0 and swap(held, name.encode(), held, f"to-{name}".encode(), 2)
"""
"""Puts a link in the place of each folder once something in it is gone, as who was handed the one above, open, may.

Go's `os.RemoveAll` opened such a folder again, by its name, after each 1024 entries.
"""
DECOY = """
printf 'FROM busybox\\nVOLUME srprov.removed.v\\n' | docker build -q -t decoy - && docker create --name decoy decoy
"""
"""Has something else at a place that is called as the volume is: an engine's filter takes that for the volume."""


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
        assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
        assert lab.shell("robot1", "sh", "-c", DECOY).code == 0
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
        lab.shell("robot1", "docker", "rm", "-fv", "decoy")
        lab.shell("robot1", "docker", "rmi", "decoy")
        lab.shell("robot1", "rm", "-rf", "/srv/led")
