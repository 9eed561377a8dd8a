"""One robot: boot it, see whether it is ready, end it, enter it.

A robot is the process tree below its PID 1 (boot.sh). Booting is done in two steps, so that many
robots start at once and a killed run leaves none behind that is not on record: `power_on` gives a
robot that waits, `go` lets it run.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Sequence, Set
from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import arm64, cable, cgroups, disk, engine, latency, network, partition, state
from srprov.lab.config import SSHD_BEHIND_PROXY
from srprov.lab.machine import SYSTEM_PATH, find
from srprov.lab.places import Site
from srprov.lab.spec import Robot

BOOT = Path(__file__).with_name("boot.sh")
PATIENCE_S = 10.0


class Waiting(msgspec.Struct, frozen=True):
    """A robot that has namespaces and a PID 1, and waits for its cable."""

    robot: Robot
    launcher: subprocess.Popen[bytes]
    init: state.Process


def power_on(site: Site, robots: Sequence[Robot]) -> list[Waiting]:
    """Start the robots' first processes; their disks are prepared, and no earlier boot is alive."""
    launched = []
    for robot in robots:
        groups = cgroups.make(site, robot.name)
        if robot.cpus is not None:
            cgroups.limit_cpus(groups, robot.cpus)
        with open(site.disk(robot.name) / "boot.log", "wb") as log:
            launcher = subprocess.Popen(
                # a shell that runs `lab up &` ignores Ctrl-C for it; a robot's logins must not inherit that
                ["/usr/bin/env", "--default-signal=INT,QUIT", "/bin/sh", str(BOOT), "enter"],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                cwd="/",
                env=_boot_settings(site, robot, groups),
                start_new_session=True,
            )
        launched.append((robot, launcher))
    return [Waiting(robot, launcher, _first_process(site, robot, launcher)) for robot, launcher in launched]


def _boot_settings(site: Site, robot: Robot, groups: Sequence[Path]) -> dict[str, str]:
    subnet = site.subnet_of(robot.lan)
    return {
        "PATH": SYSTEM_PATH,
        "LAB_NAME": robot.name,
        "LAB_DISK": str(site.disk(robot.name)),
        "LAB_ADDRESS": f"{site.address(robot.name, robot.lan)}/{subnet.prefixlen}",
        "LAB_ADDRESS6": f"{site.address6(robot.name, robot.lan)}/64" if robot.ipv6 else "",
        "LAB_GATEWAY": str(subnet.network_address + 1),
        "LAB_DEVICES": " ".join(robot.devices),
        "LAB_SYSTEMD": "yes" if robot.systemd else "no",
        "LAB_DOCKER": "yes" if robot.docker else "no",
        "LAB_DOCKERD": "-H unix:///run/lab/docker.sock" if arm64.is_simulated(robot) else "",
        "LAB_BINFMT": arm64.registration() if arm64.is_simulated(robot) else "",
        "LAB_CGROUPS": " ".join(str(group) for group in groups),
        "LAB_CGROUP_VERSION": str(cgroups.version()),
        "LAB_CGROUP_HIERARCHIES": " ".join(each.word for each in cgroups.hierarchies()),
    }


def _first_process(site: Site, robot: Robot, launcher: subprocess.Popen[bytes]) -> state.Process:
    """PID 1 of the robot: the one process in its group that is not the launcher."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and launcher.poll() is None:
        for pid in cgroups.processes(site, robot.name) - {launcher.pid}:
            init = state.Process.of(pid)
            if init is not None:
                return init
        time.sleep(0.002)
    raise LabError(
        f"{robot.name} does not boot: {_last_words(site, robot.name)}", hint=f"{site.command} down", code=Code.LAB_STUCK
    )


def go(site: Site, waiting: Sequence[Waiting]) -> None:
    """Lay the cables, note the robots and let them run."""
    cables = {each.robot: each.init.pid for each in waiting}
    network.connect(site, cables)
    for robot, init in cables.items():
        cable.spoil(site, robot, init)
    for each in waiting:
        cgroups.set_aside(site, each.robot.name, each.launcher.pid)
        state.write_robot(site, each.robot.name, state.Booted(each.init, each.robot.boot_digest))
        assert each.launcher.stdin is not None
        each.launcher.stdin.write(b"go\n")
        each.launcher.stdin.close()
        if each.robot.ssh_latency_ms:
            latency.start(site, each.robot, each.init.pid, each.robot.ssh_latency_ms)
        if each.robot.docker and arm64.is_simulated(each.robot):
            arm64.start_proxy(site, each.robot.name, each.init.pid)


def await_ready(site: Site, robots: Sequence[Robot], patience_s: float = 60.0) -> None:
    """Return when every robot is ready; LabError with the reasons otherwise."""
    until = time.monotonic() + patience_s
    pending = {robot.name: robot for robot in robots}
    cuts = partition.in_force(site)
    while pending:
        for name, robot in list(pending.items()):
            booted = state.read_robot(site, name)
            if booted is None:
                raise LabError(
                    f"{name} died while booting: {_last_words(site, name)}",
                    hint=f"{site.command} restart {name}",
                    code=Code.LAB_STUCK,
                )
            if is_ready(site, robot, booted.init.pid, cuts):
                del pending[name]
        if pending and time.monotonic() > until:
            why = "; ".join(f"{name}: {_last_words(site, name)}" for name in pending)
            raise LabError(
                f"not ready after {patience_s:.0f} s: {why}", hint=f"{site.command} status", code=Code.LAB_STUCK
            )
        if pending:
            time.sleep(0.02)
    for robot in robots:
        booted = state.read_robot(site, robot.name)
        if booted is not None and robot.docker and robot.docker_read_only:
            engine.make_read_only(booted.init.pid)


def is_ready(site: Site, robot: Robot, init: int, cuts: Set[partition.Rule]) -> bool:
    """Whether the robot's sshd greets and its Docker engine answers, but for what is broken on purpose."""
    if engine.is_wanted(robot, init) and not engine.answers(init):
        return False
    ports = {22, SSHD_BEHIND_PROXY} if robot.ssh_latency_ms else {22}
    if not ports <= listens(init):
        return False
    unreachable = not cuts.isdisjoint(partition.rules(site, robot.name, partition.CONTROLLER))
    return unreachable or bool(robot.loss_percent) or answers_ssh(site, robot)


def listens(init: int) -> set[int]:
    """The TCP ports that anything in the robot listens on.

    Asked before a connection is tried: a packet to an address that is not there yet costs a second,
    until the kernel asks for the address again.
    """
    try:
        rows = Path(f"/proc/{init}/net/tcp").read_text().splitlines()[1:]
    except OSError:
        return set()
    return {int(row.split()[1].partition(":")[2], 16) for row in rows if row.split()[3] == "0A"}


def answers_ssh(site: Site, robot: Robot) -> bool:
    """Whether the robot's sshd greets, in the time that its latency asks for."""
    patience_s = 0.5 + 4 * (robot.ssh_latency_ms.rtt_ms if robot.ssh_latency_ms else 0) / 1000
    try:
        with socket.create_connection((str(site.address(robot.name, robot.lan)), 22), timeout=patience_s) as connection:
            return connection.recv(4) == b"SSH-"
    except OSError:
        return False


def kill(site: Site, name: str) -> None:
    """End the robot at once, as by power loss; its disk stays. No error if it is dead."""
    until = time.monotonic() + PATIENCE_S
    while found := cgroups.processes(site, name):
        for pid in sorted(found):
            _signal(pid)
        if time.monotonic() > until:
            raise LabError(f"{name} does not die: processes {sorted(found)}", hint="see `dmesg`", code=Code.LAB_STUCK)
        time.sleep(0.005)
    disk.await_release(site, name)
    network.disconnect(site, name)
    cable.repair(site, name)
    cgroups.remove(site, name)
    state.forget_robot(site, name)


def _signal(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def remove(site: Site, name: str) -> None:
    """Kill the robot, and remove its disk and what cuts it off."""
    kill(site, name)
    partition.heal(site, name)
    disk.remove(site, name)


def enter(site: Site, name: str, command: Sequence[str]) -> list[str]:
    """The program that runs `command` (a login shell if empty) in the robot, not through sshd."""
    booted = state.read_robot(site, name)
    if booted is None:
        raise LabError(f"{name} is not running", hint=f"{site.command} restart {name}", code=Code.LAB_DOWN)
    inside = [
        "env",
        "-i",
        f"PATH={SYSTEM_PATH}",
        "HOME=/root",
        "USER=root",
        f"TERM={os.environ.get('TERM', 'dumb')}",
    ]
    doors = ["--mount", "--uts", "--ipc", "--net", "--pid", "--cgroup", "--root"]
    wanted = ["/bin/sh", "-c", 'cd && exec "$@"', "sh", *(command or ["/bin/bash", "-l"])]
    return [
        find("nsenter") or "nsenter",
        f"--target={booted.init.pid}",
        *doors,
        "--",
        *inside,
        *wanted,
    ]


def _last_words(site: Site, name: str) -> str:
    """The end of the robot's logs, for an error message."""
    top = site.disk(name)
    for path in (
        top / "boot.log",
        top / "upper/var/log/dockerd.log",
        top / "upper/var/log/sshd.log",
    ):
        lines = path.read_text(errors="replace").split("\n") if path.exists() else []
        said = [line.strip() for line in lines if line.strip()]
        if said:
            return f"{path.name} ends with {said[-1]!r}"
    return "it left no message"
