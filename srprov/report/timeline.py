"""When each robot acted, checked and waited, and which steps the end had to wait for. From events; pure.

A step acts from its `start` for its `duration_s`; until its `end` the robot is asked whether it is right now. What is
left until the robot's last end is waiting: for what a step needs (of another robot, or that a container is ready), or
for its turn.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from srprov.report.model import EventView, PlannedStep
from srprov.report.spans import Spans, total, united, without

_LATEST = 1e11
"""Seconds since 1970 that a clock can show."""
_LONGEST = 1e9
_MOST_LINKS = 1000
_MOST_AT_ONCE = 500
"""Steps that one round trip does, all of them begun in one moment."""
_SAME_MOMENT = 0.005
"""Seconds: events have whole milliseconds."""


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """A step as it was done; times in seconds since the first event."""

    number: int
    robot: str
    begun: float
    acted: float
    """When its commands had ended."""
    ended: float
    """When it was known to be right, or to have failed."""


class Lane(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's time."""

    robot: str
    acting: Spans
    checking: Spans
    awaiting: Spans
    """For what a step needs: of another robot, or that a container is ready."""
    end: float

    @property
    def waiting_s(self) -> float:
        """Seconds until its last end in which it neither acted nor was checked."""
        return max(0.0, self.end - total(self.acting) - total(self.checking))


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """A step that the end had to wait for."""

    task: Task
    gap: float
    """Seconds from the end of the step before it to its beginning."""


class Timeline(msgspec.Struct, frozen=True, kw_only=True):
    """All robots' time."""

    lanes: tuple[Lane, ...]
    """Those that ended last come first."""
    chain: tuple[Link, ...]
    """The critical path, in order."""
    tasks: Mapping[int, Task]
    seconds: float
    """From the first event to the last end."""


def timeline(events: Iterable[EventView], steps: Sequence[PlannedStep] = ()) -> Timeline | None:
    """Return what events tell; None where no step was begun.

    Args:
        events: Of a run, in order.
        steps: Of its plan, for what a step needs; without them, it follows only those of its own robot.
    """
    known = [one for one in events if 0 <= one.time < _LATEST and 0 <= one.duration_s < _LONGEST]
    if not known:
        return None
    first = min(one.time for one in known)
    tasks = _tasks(known, first)
    if not tasks:
        return None
    known_steps = {one.number: one for one in steps}
    lanes = _lanes(tasks.values(), known_steps, _told(known, first))
    return Timeline(
        lanes=tuple(sorted(lanes, key=lambda one: (-one.end, one.robot))),
        chain=tuple(_chain(tasks, known_steps)),
        tasks=tasks,
        seconds=max(one.ended for one in tasks.values()),
    )


def _tasks(events: Iterable[EventView], first: float) -> dict[int, Task]:
    begun: dict[int, float] = {}
    tasks: dict[int, Task] = {}
    for one in events:
        if one.step is None or not one.robot:
            continue
        if one.event == "start":
            begun.setdefault(one.step, one.time - first)
        elif one.event == "end" and one.step in begun:
            at, end = begun[one.step], max(begun[one.step], one.time - first)
            acted = min(end, at + one.duration_s)
            tasks[one.step] = Task(number=one.step, robot=one.robot, begun=at, acted=acted, ended=end)
    return tasks


def _told(events: Iterable[EventView], first: float) -> dict[str, Spans]:
    """Return robot -> from each time that it said that it waits to its next event."""
    found: dict[str, Spans] = {}
    since: dict[str, float] = {}
    for one in events:
        if not one.robot:
            continue
        if one.event == "waiting" and one.step is not None:
            since.setdefault(one.robot, one.time - first)
        elif one.event in ("start", "end") and one.robot in since:
            found.setdefault(one.robot, []).append((since.pop(one.robot), one.time - first))
    return found


def _lanes(tasks: Iterable[Task], steps: Mapping[int, PlannedStep], told: Mapping[str, Spans]) -> Iterable[Lane]:
    of: dict[str, list[Task]] = {}
    for task in tasks:
        of.setdefault(task.robot, []).append(task)
    for robot, mine in of.items():
        acting = united((one.begun, one.acted) for one in mine)
        checking = without(united((one.acted, one.ended) for one in mine), acting)
        waits = united([*_held(mine, steps), *told.get(robot, ())])
        end = max(one.ended for one in mine)
        awaiting = without(without(waits, acting), checking)
        yield Lane(robot=robot, acting=acting, checking=checking, awaiting=awaiting, end=end)


def _held(mine: Iterable[Task], steps: Mapping[int, PlannedStep]) -> Iterable[tuple[float, float]]:
    """Return from when a robot had nothing to do to when a step of it was begun that needs more than the robot."""
    free = 0.0
    for task in sorted(mine, key=lambda one: (one.begun, one.number)):
        step = steps.get(task.number)
        if step is not None and (
            step.waits or any(steps[one].robot != step.robot for one in step.needs if one in steps)
        ):
            yield free, task.begun
        free = max(free, task.ended)


def _chain(tasks: Mapping[int, Task], steps: Mapping[int, PlannedStep]) -> list[Link]:
    """Return the steps that led to the last end: before each, what it could not begin without and ended last."""
    ids = {one.id: one.number for one in steps.values()}
    of: dict[str, list[Task]] = {}
    for task in sorted(tasks.values(), key=lambda one: (one.acted, one.number)):
        of.setdefault(task.robot, []).append(task)
    ends = {robot: [one.acted for one in mine] for robot, mine in of.items()}
    now = max(tasks.values(), key=lambda one: (one.ended, one.acted, one.number))
    links: list[Link] = []
    while len(links) < _MOST_LINKS:
        before = [tasks[number] for number in _needed(steps.get(now.number), ids) if number in tasks]
        before += _last_before(now, of[now.robot], ends[now.robot])
        earlier = [one for one in before if one.acted <= now.begun + _SAME_MOMENT and one.begun < now.begun]
        if not earlier:
            links.append(Link(task=now, gap=now.begun))
            break
        last = max(earlier, key=lambda one: (one.acted, one.number))
        links.append(Link(task=now, gap=max(0.0, now.begun - last.acted)))
        now = last
    return links[::-1]


def _last_before(now: Task, mine: Sequence[Task], ends: Sequence[float]) -> list[Task]:
    """Return the task of the same robot that ended last before another was begun, if there is one."""
    at = bisect_right(ends, now.begun + _SAME_MOMENT)
    some = reversed(mine[max(0, at - _MOST_AT_ONCE) : at])
    return list(itertools.islice((one for one in some if one.begun < now.begun), 1))


def _needed(step: PlannedStep | None, ids: Mapping[str, int]) -> list[int]:
    if step is None:
        return []
    return [*step.needs, *(ids[one.id] for one in step.waits if one.id in ids)]
