"""Faults that come and go while the lab is up: partitions, and engines that crash or are stopped.

Those that a robot is booted with are options of lab-spec.yml. `lab up` undoes these here: they are
not part of what it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set

from srprov.codes import Code
from srprov.errors import LabError, UsageError
from srprov.lab import clock, engine, machine, members, partition, state
from srprov.lab.places import Site
from srprov.lab.spec import Robot


def cut(site: Site, name: str, other: str) -> None:
    """Cut a robot off from all, from the controller or from one other robot."""
    machine.require_root()
    with members.changing(site):
        _check(site, name, other)
        partition.cut(site, name, other)


def heal(site: Site, name: str, other: str) -> bool:
    """Undo that; for all, everything that cuts the robot off. False when there was nothing."""
    machine.require_root()
    with members.changing(site):
        _check(site, name, other)
        if other != partition.ALL and partition.cut_off(site, name, partition.in_force(site)) == [partition.ALL]:
            raise UsageError(
                f"{name} is cut off from all, not only from {other}",
                hint=f"{site.command} heal {name}",
                code=Code.LAB_ORDER,
            )
        return partition.heal(site, name, other)


def _check(site: Site, name: str, other: str) -> None:
    one = members.one(site, name)
    if other == name:
        raise UsageError(f"{name} cannot be cut off from itself", hint="name two robots", code=Code.LAB_ORDER)
    if other not in (partition.ALL, partition.CONTROLLER) and members.one(site, other).lan != one.lan:
        raise UsageError(
            f"{name} and {other} are in different LANs: what they send passes the controller",
            hint="name two robots of one LAN, or `--from controller`",
            code=Code.LAB_ORDER,
        )


def kill_engine(site: Site, name: str) -> None:
    """Crash a robot's engine; it comes back by itself."""
    with members.changing(site):
        engine.kill(site, name, _with_engine(site, name))


def stop_engine(site: Site, name: str) -> None:
    """Stop a robot's engine until it is started again, or the robot is."""
    with members.changing(site):
        engine.stop(site, name, _with_engine(site, name))


def restart_engine(site: Site, name: str) -> None:
    """Stop a robot's engine if it runs, and start it."""
    with members.changing(site):
        init = _with_engine(site, name)
        engine.stop(site, name, init)
        engine.start(site, name, init)


def set_clock(site: Site, name: str, offset_s: float) -> None:
    """Have a robot's clock off by so many seconds from now on."""
    machine.require_root()
    if not abs(offset_s) <= clock.MOST_S:
        raise UsageError(
            f"a clock cannot be {offset_s:g} s off",
            hint=f"at most {clock.MOST_S:g} s, in either direction",
            code=Code.LAB_ORDER,
        )
    with members.changing(site):
        members.one(site, name)
        clock.set_off(_booted(site, name), offset_s)


def _booted(site: Site, name: str) -> int:
    """PID 1 of a robot that runs."""
    booted = state.read_robot(site, name)
    if booted is None:
        raise LabError(f"{name} is not running", hint=f"{site.command} restart {name}", code=Code.LAB_DOWN)
    return booted.init.pid


def _with_engine(site: Site, name: str) -> int:
    """PID 1 of a robot that has an engine."""
    machine.require_root()
    robot = members.one(site, name)
    init = _booted(site, name)
    if not robot.docker:
        raise UsageError(f"{name} has no Docker", hint="its options say `docker: false`", code=Code.LAB_ORDER)
    return init


def cuts_of(site: Site, name: str, there: Set[partition.Rule]) -> tuple[str, ...]:
    """The partitions of a robot, in words."""
    return tuple(f"cut off from {other}" for other in partition.cut_off(site, name, there))


def of_robot(robot: Robot, init: int) -> tuple[str, ...]:
    """What is wrong with a robot's clock and engine on purpose, in words."""
    if not robot.docker:
        return clock.of(init)
    return (*clock.of(init), *_of_engine(init))


def _of_engine(init: int) -> tuple[str, ...]:
    stopped = ("docker stopped",) if engine.is_stopped(init) else ()
    return (*stopped, "docker read-only") if engine.is_read_only(init) else stopped


def undo(site: Site, robots: Sequence[Robot], say: Callable[[str], None]) -> None:
    """Heal all partitions, put clocks back and start the engines that were stopped, of robots that run."""
    if partition.heal_all(site):
        say("healing partitions")
    for robot in robots:
        booted = state.read_robot(site, robot.name)
        if booted is not None and clock.put_back(booted.init.pid):
            say(f"putting back the clock of {robot.name}")
        if booted is not None and robot.docker and engine.is_stopped(booted.init.pid):
            say(f"starting Docker on {robot.name}")
            engine.start(site, robot.name, booted.init.pid)
