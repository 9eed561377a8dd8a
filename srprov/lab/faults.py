"""Faults that come and go while the lab is up: partitions, and engines that crash or are stopped.

Those that a robot is booted with are options of lab-spec.yml. `lab up` undoes these here: they are
not part of what it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set

from srprov.errors import LabError, UsageError
from srprov.lab import engine, machine, members, partition, state
from srprov.lab.spec import Robot


def cut(name: str, other: str) -> None:
    """Cut a robot off from all, from the controller or from one other robot."""
    machine.require_root()
    with state.locked():
        _check(name, other)
        partition.cut(name, other)


def heal(name: str, other: str) -> bool:
    """Undo that; for all, everything that cuts the robot off. False when there was nothing."""
    machine.require_root()
    with state.locked():
        _check(name, other)
        if other != partition.ALL and partition.cut_off(name, partition.in_force()) == [partition.ALL]:
            raise UsageError(f"{name} is cut off from all, not only from {other}", hint=f"srprov lab heal {name}")
        return partition.heal(name, other)


def _check(name: str, other: str) -> None:
    members.one(name)
    if other == name:
        raise UsageError(f"{name} cannot be cut off from itself", hint="name two robots")
    if other not in (partition.ALL, partition.CONTROLLER):
        members.one(other)


def kill_engine(name: str) -> None:
    """Crash a robot's engine; it comes back by itself."""
    with state.locked():
        engine.kill(name, _with_engine(name))


def stop_engine(name: str) -> None:
    """Stop a robot's engine until it is started again, or the robot is."""
    with state.locked():
        engine.stop(name, _with_engine(name))


def restart_engine(name: str) -> None:
    """Stop a robot's engine if it runs, and start it."""
    with state.locked():
        init = _with_engine(name)
        engine.stop(name, init)
        engine.start(name, init)


def _with_engine(name: str) -> int:
    """PID 1 of a robot that has an engine."""
    machine.require_root()
    robot = members.one(name)
    booted = state.read_robot(name)
    if booted is None:
        raise LabError(f"{name} is not running", hint=f"srprov lab restart {name}")
    if not robot.docker:
        raise UsageError(f"{name} has no Docker", hint="its options say `docker: false`")
    return booted.init.pid


def cuts_of(name: str, there: Set[partition.Rule]) -> tuple[str, ...]:
    """The partitions of a robot, in words."""
    return tuple(f"cut off from {other}" for other in partition.cut_off(name, there))


def of_engine(robot: Robot, init: int) -> tuple[str, ...]:
    """What is wrong with a robot's engine on purpose, in words."""
    if not robot.docker:
        return ()
    stopped = ("docker stopped",) if engine.is_stopped(init) else ()
    return (*stopped, "docker read-only") if engine.is_read_only(init) else stopped


def undo(robots: Sequence[Robot], say: Callable[[str], None]) -> None:
    """Heal all partitions and start the engines that were stopped, of robots that run."""
    if partition.heal_all():
        say("healing partitions")
    for robot in robots:
        booted = state.read_robot(robot.name)
        if booted is not None and robot.docker and engine.is_stopped(booted.init.pid):
            say(f"starting Docker on {robot.name}")
            engine.start(robot.name, booted.init.pid)
