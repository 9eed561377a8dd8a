"""Locks of a whole run, on robots in memory: all or none, whoever else wants them, and never for ever."""

from __future__ import annotations

import functools
import itertools
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from srprov.errors import LockHeld
from srprov.execution import Outcome, RunOptions, lock_set, run_plan
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.execution.locks import Claim, Holder, age, parse_holder
from srprov.session import Pulse
from tests.fakes import FakeLockChannel, World
from tests.worlds import QUICK, events, experiment, plan_for, run, service

NAMES = ("r1", "r2", "r3", "r4", "r5")


def claim(owner: str = "anna@desk") -> Claim:
    return Claim(owner=owner, pid=7, purpose="apply hello", run="4711")


def taken(
    world: World,
    names: Sequence[str],
    *,
    owner: str = "anna@desk",
    wait_s: float = 0.0,
    stop: threading.Event | None = None,
) -> LockSet:
    """Take these robots as a run does."""
    patience = LockOptions(wait_s=wait_s)
    return LockSet(
        names, world.sessions(), claim(owner), patience, stop or threading.Event(), lambda _event: None
    ).acquire()


def together(works: Sequence[Callable[[], None]]) -> None:
    """Do all of it at once, each in a thread of its own; nothing may last."""
    threads = [threading.Thread(target=work, daemon=True) for work in works]
    for thread in threads:
        thread.start()
    until = time.monotonic() + 40
    for thread in threads:
        thread.join(until - time.monotonic())
        assert not thread.is_alive()


def held(world: World) -> dict[str, str]:
    """Return robot -> owner."""
    return {name: robot.holder.claim.split('"')[3] for name, robot in world.robots.items() if robot.holder}


def test_a_run_holds_what_it_changes_and_gives_it_back() -> None:
    """While the first command runs the robot is held with who and what; afterwards no robot is."""
    world = World().add("r1", "r2")
    plan = plan_for(world, experiment(service("a", robot="r1")))
    seen: list[str] = []
    world.robots["r1"].before_command = lambda _command: seen.append(world.robots["r1"].holder.claim)  # type: ignore[union-attr]
    result = run(world, plan)
    assert result.exit_code == 0
    assert seen and all('"purpose":"apply hello"' in one for one in seen)
    assert held(world) == {}


def test_a_held_robot_stops_the_run_before_its_first_act() -> None:
    """LockHeld (7) says who, what, since when and what to do; nothing was done and no other robot stays locked."""
    world = World().add("r1", "r2")
    plan = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r2")))
    with taken(world, ["r2"]), pytest.raises(LockHeld) as caught:
        run(world, plan)
    error = caught.value
    assert error.exit_code == 7
    assert error.message.startswith("r2 is held by anna@desk, process 7: apply hello, since 20")
    assert "UTC (3 min); nothing was changed" in error.message
    assert "--lock-wait SECONDS" in error.hint
    assert world.done() == [] and held(world) == {}


def test_who_waits_is_told_for_whom_and_goes_on_when_it_is_free() -> None:
    """With --lock-wait a line names the holder, and the run begins when he has gone."""
    world = World().add("r1")
    plan = plan_for(world, experiment(service("a")))
    other = taken(world, ["r1"])
    timer = threading.Timer(0.4, other.release)
    timer.start()
    result, heard = events(world, plan, RunOptions(settle_s=0.0, lock_wait_s=20.0))
    assert result.exit_code == 0 and result.count(Outcome.CHANGED) == len(plan.steps)
    said = [event.text for event in heard if event.kind == "waiting" and event.host == "r1"]
    assert any("held by anna@desk, process 7: apply hello" in text and "waiting up to 20 s" in text for text in said)


def test_waiting_ends_after_its_time() -> None:
    """Not before the seconds that were asked for, and soon after them."""
    world = World().add("r1")
    with taken(world, ["r1"]):
        begun = time.monotonic()
        with pytest.raises(LockHeld, match=r"was not free within 1\.5 s"):
            taken(world, ["r1"], owner="bob@desk", wait_s=1.5)
        assert 1.4 < time.monotonic() - begun < 15


def test_whoever_waited_finds_the_work_done() -> None:
    """Two controllers made the same plan; the second one reads again after it got the lock, and changes nothing."""
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2"))
    first, second = plan_for(world, what), plan_for(world, what)
    assert run(world, first).exit_code == 0
    before = world.state()
    late = run(world, second)
    assert {one.outcome for one in late.results} == {Outcome.UNCHANGED}
    assert {one.message for one in late.results} == {"somebody was faster"}
    assert world.state() == before


def test_whoever_waited_refuses_a_stale_plan() -> None:
    """The lock does not make an old plan right: what differs from what it was made for is not touched."""
    world = World().add("r1")
    old = plan_for(world, experiment(service("a", command=("sleep", "1"))))
    assert run(world, plan_for(world, experiment(service("a", command=("sleep", "2"))))).exit_code == 0
    before = world.state()["r1"]["containers"]
    late = run(world, old)
    assert late.exit_code == 3
    assert any("changed since the plan was made" in one.message for one in late.results)
    assert world.state()["r1"]["containers"] == before


OVERLAPS = [
    (("r1", "r2", "r3"), ("r1", "r2", "r3")),
    (("r1", "r3", "r4"), ("r2", "r3", "r4")),
    (("r1", "r4", "r5"), ("r2", "r3", "r4", "r5")),
    (("r1", "r5"), ("r5",)),
]


@pytest.mark.parametrize("_turn", range(5))
@pytest.mark.parametrize(("mine", "theirs"), OVERLAPS)
def test_of_two_that_want_the_same_exactly_one_goes_on(
    mine: tuple[str, ...], theirs: tuple[str, ...], _turn: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever is first where: one has all of its robots, the other none, and neither waits for ever."""
    monkeypatch.setattr(lock_set, "_GRACE_S", 0.3)
    world = World().add(*NAMES)
    ready = threading.Barrier(2)
    got: list[tuple[str, tuple[str, ...], LockSet]] = []
    lost: list[str] = []

    def one(owner: str, names: tuple[str, ...]) -> None:
        ready.wait()
        try:
            got.append((owner, names, taken(world, names, owner=owner)))
        except LockHeld:
            lost.append(owner)

    together([lambda: one("anna", mine), lambda: one("bob", theirs)])
    assert (len(got), len(lost)) == (1, 1)
    owner, names, locks = got[0]
    assert held(world) == dict.fromkeys(names, owner)
    locks.release()
    assert held(world) == {}


def test_a_knot_is_untied() -> None:
    """Each gets a robot that the other wants next: who waits gives back what lies behind, so both get their turn."""
    world = World().add(*NAMES)
    got: list[str] = []
    meet = threading.Barrier(2, timeout=5)
    tried = {"r3": threading.Event(), "r4": threading.Event()}

    class Crossed:
        """A robot that one of the two reaches first: anna r3, bob r4."""

        def __init__(self, name: str, owner: str) -> None:
            self.name, self.first = name, owner == ("anna" if name == "r3" else "bob")

        def open_lock_channel(self, script: str, words: Sequence[str], pulse: Pulse) -> FakeLockChannel:
            if not self.first:
                assert tried[self.name].wait(5)
            made = world.robots[self.name].open_lock_channel(script, words, pulse)
            tried[self.name].set()
            return made

    def one(owner: str, names: tuple[str, ...]) -> None:
        sessions: dict[str, Any] = {n: Crossed(n, owner) if n in tried else world.robots[n] for n in names}
        meet.wait()
        with LockSet(
            names, sessions, claim(owner), LockOptions(wait_s=30), threading.Event(), lambda _event: None
        ).acquire():
            assert held(world).items() >= dict.fromkeys(names, owner).items()
            got.append(owner)

    begun = time.monotonic()
    together([lambda: one("anna", ("r1", "r3", "r4")), lambda: one("bob", ("r2", "r3", "r4"))])
    assert sorted(got) == ["anna", "bob"]
    assert time.monotonic() - begun < 10, "neither may wait until the other gives up"


def test_many_controllers_and_random_parts() -> None:
    """All get their turn with --lock-wait, never two at once on one robot, and nothing stays held."""
    world = World().add(*NAMES)
    parts = list(itertools.combinations(NAMES, 2))
    working: dict[str, str] = {}
    errors: list[str] = []

    def one(number: int) -> None:
        names = parts[number % len(parts)]
        try:
            with taken(world, names, owner=str(number), wait_s=30):
                for name in names:
                    if name in working:
                        errors.append(f"{number} and {working[name]} on {name}")
                    working[name] = str(number)
                time.sleep(0.01)
                for name in names:
                    del working[name]
        except LockHeld as error:
            errors.append(error.message)

    together([functools.partial(one, number) for number in range(20)])
    assert errors == [] and held(world) == {}


def test_an_interrupt_while_waiting_changes_nothing() -> None:
    """The report is made at once, every step not reached, and our own locks are free."""
    world = World().add("r1", "r2")
    plan = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r2")))
    stop = threading.Event()
    with taken(world, ["r2"]):
        threading.Timer(0.3, stop.set).start()
        begun = time.monotonic()
        result = run_plan(plan, world.sessions(), lambda _event: None, RunOptions(lock_wait_s=60), stop)
        assert time.monotonic() - begun < 30
        assert held(world) == {"r2": "anna@desk"}
    assert result.exit_code == 130
    assert {one.outcome for one in result.results} == {Outcome.NOT_REACHED}
    assert world.done() == []


def test_a_bug_frees_no_lock_under_a_step_that_still_runs() -> None:
    """A run that ends by an exception ends its sessions: each robot stops what runs there before its lock is free."""
    world = World().add("r1", "r2")
    plan = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r2")))
    busy, over = threading.Event(), threading.Event()

    def last(_command: object) -> None:
        busy.set()
        assert over.wait(20)

    def bug(_command: object) -> None:
        assert busy.wait(20)
        raise RuntimeError("a bug")

    world.robots["r1"].before_command, world.robots["r2"].before_command = bug, last
    try:
        with pytest.raises(RuntimeError, match="a bug"):
            run(world, plan)
        assert not world.robots["r2"].released_while_busy
        assert held(world) == {} and world.robots["r2"].gone
    finally:
        over.set()


def test_a_robot_that_is_gone_is_no_reason_to_stop_the_others() -> None:
    """It is lost as a value, with the reason; the others are locked and changed."""
    world = World().add("r1", "r2")
    plan = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r2")))
    sessions = world.sessions()
    world.robots["r1"].gone = True
    result = run_plan(plan, sessions, lambda _event: None, QUICK)
    assert result.exit_code == 4
    assert list(result.unreachable) == ["r1"] and "connection was lost" in result.unreachable["r1"]
    assert {one.step.host for one in result.results if one.outcome is Outcome.CHANGED} == {"r2"}
    assert held(world) == {}


def test_a_robot_that_cannot_be_locked_says_why() -> None:
    """A missing tool is the robot's own failure, in words."""
    world = World().add("r1")
    world.robots["r1"].open_lock_channel = lambda *_words: type(  # type: ignore[assignment,method-assign]
        "Channel", (), {"first_answer": "no flock is not installed on the robot", "close": lambda _self: None}
    )()
    locks = taken(world, ["r1"])
    assert (locks.held, locks.lost) == (set(), {"r1": "it cannot be locked: flock is not installed on the robot"})


@pytest.mark.parametrize(
    "text",
    ["", "x", "2026-11-21T02:00:00Z", "2026-11-21T02:00:00Z {", "2026-11-21T02:00:00Z []", "2026-11-21T02:00:00Z 7",
     '9999-01-01T00:00:00Z {"since": "0001-01-01T00:00:00Z"}', '2926-11-21T02:00:00Z {"since": "1026-11-21T02:00:00Z"}',
     '2026-11-21T02:00:00Z {"owner": 7, "pid": "x", "purpose": [], "since": {}, "run": null}', "\0\0 \0"],
)  # fmt: skip
def test_a_holder_file_is_believed_nothing(text: str) -> None:
    """Whatever stands in it, it is only words; those that are not there are empty."""
    assert parse_holder(text) == Holder()
    assert str(parse_holder(text)) == "somebody who did not say who"


def test_a_holder_is_told_in_this_machines_time() -> None:
    """Robots' clocks may be years off; what counts is how long ago it was for the robot."""
    words = '{"owner":"anna@desk","pid":7,"purpose":"apply hello","run":"r","since":"1970-01-01T00:00:10Z"}'
    told = parse_holder(f"1970-01-01T00:02:15Z {words}")
    assert (told.owner, told.pid, told.purpose, told.run, told.age_s) == ("anna@desk", 7, "apply hello", "r", 125)
    assert (
        abs(time.mktime(time.strptime(told.since, "%Y-%m-%d %H:%M:%S UTC")) - time.timezone - (time.time() - 125)) < 3
    )
    assert len(parse_holder(f'1970-01-01T00:02:15Z {{"owner":"{"x" * 999}"}}').owner) == 200


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0 s"), (59, "59 s"), (60, "1 min"), (3599, "59 min"), (7500, "2 h 5 min")]
)
def test_ages_are_short(seconds: int, words: str) -> None:
    """One unit below an hour, two above."""
    assert age(seconds) == words


def test_nothing_to_do_takes_no_lock() -> None:
    """An empty plan goes by a robot that somebody holds."""
    world = World().add("r1")
    what = experiment(service("a"))
    assert run(world, plan_for(world, what)).exit_code == 0
    with taken(world, ["r1"]):
        result = run(world, plan_for(world, what))
    assert (result.exit_code, result.results) == (0, ())
