"""What was or would be done on each robot: steps, causes, outcomes. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec

from srprov.report.html import NOTHING, Child, Html, el, join, lines, whole
from srprov.report.material import Material
from srprov.report.model import Different, PlannedStep, RobotEnd, StepEnd
from srprov.report.parts import Section, action, fold, outcome, table
from srprov.report.timeline import Task
from srprov.report.words import counted, natural, number, pointer, seconds, size

_MOST_STEPS = 2000
"""Rows of steps in a page; of the other robots there are only sums."""
_MOST_ROBOTS = 400
_MOST_VALUES = 40
"""Changed values of one step."""
_MOST_FAILURES = 300
_LONGEST_MESSAGE = 4000
_WELL = frozenset({"changed", "unchanged"})


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """A step, planned or ended or both."""

    number: int
    robot: str
    what: str
    action: str = ""
    cause: str = ""
    makes: str = ""
    destructive: bool = False
    after: str = ""
    differences: tuple[Different, ...] = ()
    outcome: str = ""
    message: str = ""

    @property
    def bad(self) -> bool:
        """Whether it did not end well."""
        return bool(self.outcome) and self.outcome not in _WELL


def rows_of(material: Material) -> list[Row]:
    """Return every step of a plan or a run, by number."""
    ends = {one.number: one for one in material.result.steps} if material.result is not None else {}
    steps = {one.number: one for one in material.plan.steps} if material.plan is not None else {}
    return [_row(number_, steps.get(number_), ends.get(number_)) for number_ in sorted({*ends, *steps})]


def _row(at: int, step: PlannedStep | None, end: StepEnd | None) -> Row:
    outcome_, message = (end.outcome, end.message) if end is not None else ("", "")
    if step is None:
        robot, _, what = end.id.partition("/") if end is not None else ("", "", "")
        return Row(number=at, robot=robot, what=what, outcome=outcome_, message=message)
    after = [f"#{one}" for one in step.needs] + [f"{one.id} {one.condition}" for one in step.waits]
    return Row(
        number=at, robot=step.robot, what=f"{step.module}:{step.name}", action=step.action,
        cause=step.cause, makes=step.makes, destructive=step.destructive, after=", ".join(after),
        differences=step.differences, outcome=outcome_, message=message,
    )  # fmt: skip


def failures(material: Material) -> Section | None:
    """Return what did not end well, with what was said; None where all did."""
    bad = [one for one in rows_of(material) if one.bad]
    if not bad:
        return None
    bad.sort(key=lambda one: (one.outcome != "failed", one.number))
    parts = [
        el("article", el("h3", f"#{one.number} on {one.robot}: ", el("code", one.what)), outcome(one.outcome),
           el("pre", lines(one.message, _LONGEST_MESSAGE), tabindex="0") if one.message else NOTHING)
        for one in bad[:_MOST_FAILURES]
    ]  # fmt: skip
    more = len(bad) - _MOST_FAILURES
    rest = el("p", f"and {more} more, in the data of this page") if more > 0 else NOTHING
    return Section(id="failures", title="What did not end well", body=join([*parts, rest]))


def changes(material: Material, tasks: Mapping[int, Task]) -> Section | None:
    """Return the steps of each robot, folded; None where there are none."""
    rows = rows_of(material)
    if not rows:
        return None
    of: dict[str, list[Row]] = {}
    for one in rows:
        of.setdefault(one.robot, []).append(one)
    first = sorted(of, key=lambda robot: (not any(one.bad or one.destructive for one in of[robot]), natural(robot)))
    ends = material.result.robots if material.result is not None else {}
    return Section(id="changes", title="Changes by robot", body=join(_robots(first, of, ends, tasks)))


def _robots(
    order: list[str], of: Mapping[str, list[Row]], ends: Mapping[str, RobotEnd], tasks: Mapping[int, Task]
) -> Iterator[Html]:
    left, shown = _MOST_STEPS, 0
    for robot in order:
        if len(of[robot]) > left:
            break
        left, shown = left - len(of[robot]), shown + 1
        yield fold(_summary(robot, of[robot]), _values(of[robot]), _steps(robot, of[robot], tasks))
    if shown < len(order):
        text = f"Steps of {len(order) - shown} more robots are left out; a page has {_MOST_STEPS} at most."
        yield el("p", text, class_="soft")
    if ends:
        yield fold(f"What it took on {counted(len(ends), 'robot')}", _effort(ends))


def _summary(robot: str, rows: list[Row]) -> list[Child]:
    counts: dict[str, int] = {}
    for one in rows:
        word = one.outcome or one.action
        counts[word] = counts.get(word, 0) + 1
    lost = sum(one.destructive for one in rows)
    words = ", ".join(f"{count} {word}" for word, count in counts.items())
    return [
        el("b", el("bdi", robot)),
        f" {words}",
        el("span", "  data is lost", class_="mark bad") if lost else NOTHING,
    ]


def _values(rows: list[Row]) -> Html:
    """Return the values that steps change, with old and new."""
    parts: list[Html] = []
    for row in (one for one in rows if one.differences):
        parts.append(el("h3", f"#{row.number} ", el("code", row.what)))
        plain = [one for one in row.differences[:_MOST_VALUES] if not one.diff]
        body: list[list[Child]] = [[el("code", one.field), *_sides(one)] for one in plain]
        if body:
            parts.append(table(f"Values that step {row.number} changes", ["value", "now", "then"], body, kind="long"))
        for one in (one for one in row.differences[:_MOST_VALUES] if one.diff):
            parts.append(el("pre", lines("\n".join([one.field, *one.diff]), _LONGEST_MESSAGE), tabindex="0"))
        if len(row.differences) > _MOST_VALUES:
            parts.append(el("p", f"and {len(row.differences) - _MOST_VALUES} more values"))
    return join(parts)


def _sides(one: Different) -> list[Child]:
    if one.note:
        return [one.note, ""]
    return ["not set" if side is None else el("code", side) for side in (one.old, one.new)]


def _steps(robot: str, rows: list[Row], tasks: Mapping[int, Task]) -> Html:
    done = any(one.outcome for one in rows)
    head = ["#", "action", "what", "why", "after", *(("outcome", "began at", "acted") if done else ())]
    body: list[list[Child]] = []
    for one in rows:
        why: list[Child] = [one.cause, "; " if one.cause and one.makes else "", whole(one.makes)]
        if one.destructive:
            why.append(el("span", " data is lost", class_="mark bad"))
        cells: list[Child] = [
            one.number,
            action(one.action) if one.action else "",
            el("code", one.what),
            why,
            one.after,
        ]
        if done:
            cells += [outcome(one.outcome), *_times(tasks.get(one.number))]
        body.append(cells)
    return table(f"Steps on {robot}", head, body, numbers=(6, 7), kind="long")


def _times(task: Task | None) -> list[Child]:
    """Return when a step was begun, and how long it acted."""
    if task is None:
        return ["", ""]
    return [seconds(round(task.begun, 3)), seconds(round(task.acted - task.begun, 3))]


_COUNTS = ("changed", "failed", "connections", "round_trips")
_BYTES = ("bytes_sent", "bytes_received")
_TIMES = ("connect_s", "asked_s", "acted_s", "duration_s")
_EFFORT = ("robot", "changed", "failed", "connections", "round trips", "sent", "received", "connecting", "asking",
           "acting", "steps")  # fmt: skip


def _effort(ends: Mapping[str, RobotEnd]) -> Html:
    """Return what the run had to send and wait for, robot by robot, as result.json has it."""
    rows: list[list[Child]] = []
    for robot in sorted(ends, key=natural)[:_MOST_ROBOTS]:
        one = ends[robot]
        at = {key: pointer("robots", robot, key) for key in (*_COUNTS, *_BYTES, *_TIMES)}
        counts = [number(getattr(one, key), of=at[key]) for key in _COUNTS]
        sizes = [size(getattr(one, key), of=at[key]) for key in _BYTES]
        rows.append([robot, *counts, *sizes, *(seconds(getattr(one, key), of=at[key]) for key in _TIMES)])
    more = len(ends) - _MOST_ROBOTS
    rest = el("p", f"and {more} more robots, in the data of this page") if more > 0 else NOTHING
    return join([table("Connections, traffic and time", _EFFORT, rows, numbers=range(1, 11)), rest])
