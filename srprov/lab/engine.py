"""The Docker engine of a robot, from outside: does it answer, end it, stop it, start it.

boot.sh starts it again when it ends, unless a file in the robot's /run says that it shall stay
down. The robot's files are reached through /proc, by its PID 1.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import time
from pathlib import Path

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import cgroups
from srprov.lab.machine import run
from srprov.lab.places import Site
from srprov.lab.spec import Robot

DATA = "/var/lib/docker"
PATIENCE_S = 30.0


def answers(init: int) -> bool:
    """Whether the engine answers; asked through the robot's own root folder."""
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(1.0)
            connection.connect(f"/proc/{init}/root/run/docker.sock")
            connection.sendall(b"GET /_ping HTTP/1.0\r\n\r\n")
            return b" 200 " in connection.recv(64)
    except OSError:
        return False


def process(site: Site, name: str, init: int) -> int | None:
    """The process id of the robot's dockerd; one inside a container has another view of the disk and is not it."""
    for pid in sorted(cgroups.processes(site, name)):
        with contextlib.suppress(OSError):
            same = os.readlink(f"/proc/{pid}/ns/mnt") == os.readlink(f"/proc/{init}/ns/mnt")
            if same and Path(f"/proc/{pid}/comm").read_text().strip() == "dockerd":
                return pid
    return None


def is_wanted(robot: Robot, init: int) -> bool:
    """Whether the robot is not ready without its engine: it has one, and nobody has broken it on purpose."""
    return robot.docker and not is_stopped(init) and not is_read_only(init)


def is_stopped(init: int) -> bool:
    """Whether the engine shall stay down."""
    return _stopped(init).exists()


def _stopped(init: int) -> Path:
    return Path(f"/proc/{init}/root/run/lab/docker-stopped")


def kill(site: Site, name: str, init: int) -> None:
    """End dockerd at once, as by a crash; boot.sh starts it again two seconds later."""
    _end(site, name, init, signal.SIGKILL)


def stop(site: Site, name: str, init: int) -> None:
    """Stop dockerd in an orderly way; it stays down until `start`, or until the robot boots."""
    _stopped(init).touch()
    _end(site, name, init, signal.SIGTERM)


def start(site: Site, name: str, init: int) -> None:
    """Have a dockerd that answers; one that runs is left alone."""
    _stopped(init).unlink(missing_ok=True)
    until = time.monotonic() + PATIENCE_S
    while not answers(init):
        if time.monotonic() > until:
            raise LabError(
                f"{name}: dockerd does not come back",
                hint=f"{site.command} shell {name} cat /var/log/dockerd.log",
                code=Code.LAB_STUCK,
            )
        time.sleep(0.05)


def _end(site: Site, name: str, init: int, how: signal.Signals) -> None:
    until = time.monotonic() + PATIENCE_S
    pid = process(site, name, init)
    if pid is None:
        return
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, how)
    while process(site, name, init) == pid:
        if time.monotonic() > until:
            raise LabError(
                f"{name}: dockerd does not end", hint=f"{site.command} kill {name} --docker", code=Code.LAB_STUCK
            )
        time.sleep(0.02)


def is_read_only(init: int) -> bool:
    """Whether the engine's data can only be read."""
    try:
        mounts = Path(f"/proc/{init}/mounts").read_text().splitlines()
    except OSError:
        return False
    options = [fields[3] for fields in map(str.split, mounts) if fields[1] == DATA]
    return bool(options) and "ro" in options[-1].split(",")


def make_read_only(init: int) -> None:
    """Make the engine's data read-only below the running engine; what it has open it may still write."""
    if not is_read_only(init):
        script = f"mount --bind {DATA} {DATA} && mount -o remount,bind,ro {DATA}"
        run(["nsenter", f"--target={init}", "--mount", "--root", "--", "/bin/sh", "-c", script])
