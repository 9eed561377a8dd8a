"""Whether `cp` holds a robot's lock, on robots in memory: only where an old engine is asked for files."""

from __future__ import annotations

import threading

import pytest

from srprov.controller.standing_still import standing_still
from srprov.errors import LockHeld
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.execution.locks import claim
from tests.fakes import World
from tests.worlds import experiment, plan_for, run, service

NAME = "srprov.hello.a"


def made(state: str) -> World:
    """Return a robot with one container."""
    world = World().add("r1")
    assert run(world, plan_for(world, experiment(service("a", robot="r1")))).exit_code == 0
    world.robots["r1"].engine.containers[NAME].state = state
    return world


def test_nobody_starts_anything_while_an_old_engine_is_asked_for_files() -> None:
    """What starts meanwhile, and has one of the container's volumes, could lead the engine elsewhere."""
    world = made("exited")
    with standing_still(world.sessions()["r1"], NAME):
        holder = world.robots["r1"].holder
        assert holder is not None and '"purpose":"cp"' in holder.claim
    assert world.robots["r1"].holder is None


def test_somebody_elses_lock_is_told() -> None:
    world = made("exited")
    sessions, stop = world.sessions(), threading.Event()
    theirs = LockSet(["r1"], sessions, claim("apply hello"), LockOptions(), stop, lambda _event: None).acquire()
    with (
        theirs,
        pytest.raises(LockHeld, match=r"r1 is held by .*: apply hello") as told,
        standing_still(sessions["r1"], NAME),
    ):
        pass
    assert "--lock-wait" not in told.value.hint


@pytest.mark.parametrize("how", ["running", "mended"])
def test_no_lock_is_taken_where_the_engine_is_not_led(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = made("running" if how == "running" else "exited")
    if how == "mended":
        monkeypatch.setattr("srprov.controller.standing_still.is_mended", lambda _version: True)
    with standing_still(world.sessions()["r1"], NAME):
        assert world.robots["r1"].holder is None
