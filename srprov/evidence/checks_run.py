"""Checks of a run's story: what follows from the definitions, and whether journal, tables and folders tell the same."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from srprov.assignment import solve
from srprov.errors import SrprovError
from srprov.evidence.files import Files, Undecided, content, json_of
from srprov.evidence.session import Session
from srprov.evidence.story import Attempt, Story, attempt_folder, attempt_of
from srprov.record.tables import Tables
from srprov.trials.judge import COUNTED
from srprov.trials.marks import DISCARD, RERUN
from srprov.trials.reading import engine_time
from srprov.untrusted import decimal, string

_OF_RUN = frozenset({"run", "resume", "accept", DISCARD, RERUN, "ended"})
"""Events that are of no attempt."""
_SEARCH_S = 10.0
"""For the placements of all sessions together: nobody waits longer for a stranger's."""
_SAME_COST = 1e-6


def design(story: Story) -> Iterator[str]:
    """Work out points, ids, seeds and the order again, and compare the attempts with them."""
    for row in story.ended:
        session = story.of.get(attempt_of(row))
        if "point" not in row:  # of an earlier design, lost by a kill
            continue
        place = session.places.get(string(row.get("trial"))) if session else None
        if session is None or place is None:
            yield f"{attempt_folder(row)}: the design has no such trial"
            continue
        trial = session.design.trials[place - 1]
        expected: dict[str, object] = {"point": trial.point.id, "repetition": trial.repetition, "seed": trial.seed}
        expected |= {f"p_{name}": value for name, value in trial.point.values.items()}
        for key, value in expected.items():
            if row.get(key) != value:
                yield f"{attempt_folder(row)}: {key} is {_short(row.get(key))}, and follows as {value}"


def order(story: Story) -> Iterator[str]:
    """Compare the order in which attempts were begun with the design's."""
    before: tuple[Session | None, int, str] = (None, 0, "")
    for one in story.events:
        if one["event"] in ("run", "resume"):
            before = (None, 0, "")
        if one["event"] != "begin":
            continue
        session, trial = story.of.get(attempt_of(one)), string(one.get("trial"))
        place = session.places.get(trial, 0) if session else 0
        if place != one.get("order"):
            yield f"{trial}: its place is {_short(one.get('order'))}, and follows as {place}"
        if place < before[1] or (place == before[1] and trial != before[2]):
            yield f"{trial} was begun after a trial that comes later in the design"
        before = (session, place, trial)


def placement(story: Story, files: Files, *, ours: bool) -> Iterator[str]:
    """Solve each session's assignment again.

    Args:
        story: The run.
        files: Of the run.
        ours: This very srprov solved it, so that it decides alike also where several placements cost the same.

    Raises:
        Undecided: A search came to no end in time.
    """
    done, end, late = set[int](), time.monotonic() + _SEARCH_S, list[str]()
    for session in story.sessions:
        if id(session.choice) in done:
            continue
        done.add(id(session.choice))
        said = json_of(files, f"{session.home}/assignment.json").get("cost")
        cost = decimal(said, low=-1e12, high=1e12, default=float("nan"))
        try:
            again = solve.solve(session.choice.problem, max(0.1, end - time.monotonic()))
        except SrprovError as error:
            yield f"{session.home}: there is no placement: {error.message}"
            continue
        if again.gap:
            late.append(session.home)
            continue
        if not abs(again.cost - cost) <= _SAME_COST:
            yield f"{session.home}: the best placement costs {again.cost:.6f}, not {_short(said)}"
        elif ours and dict(again.placed) != dict(session.assignment):
            yield f"{session.home}: the best placement is {dict(again.placed)}, not {dict(session.assignment)}"
    if late:
        raise Undecided(f"the best placement of {', '.join(late)} was not found in {_SEARCH_S:.0f} s")


def journal(story: Story) -> Iterator[str]:
    """Follow the events: each attempt begins once and ends once, in time."""
    open_: set[Attempt] = set()
    begun: dict[str, int] = {}
    clock, sessions = 0.0, 0
    for number, one in enumerate(story.events, start=1):
        event, attempt = string(one["event"]), attempt_of(one)
        if event in ("run", "resume"):
            sessions, clock = sessions + 1, 0.0
        now = decimal(one.get("monotonic"), low=0.0, high=1e12, default=-1.0)
        if (now < clock and event != DISCARD) or not engine_time(string(one.get("utc"))):
            yield f"event {number} is earlier than the one before it, or has no time"
        clock = 0.0 if event == DISCARD else now  # a later srprov noted it, perhaps after this machine was restarted
        if event == "begin":
            begun[attempt[0]] = begun.get(attempt[0], 0) + 1
            if attempt[1] != begun[attempt[0]]:
                yield f"event {number}: attempt {attempt[1]} at {attempt[0]} is its number {begun[attempt[0]]}"
            open_.add(attempt)
        elif event not in _OF_RUN and attempt not in open_:
            yield f"event {number}: {event} of an attempt at {attempt[0]} that is not under way"
        elif event == "end":
            open_.discard(attempt)
    if sessions != len(story.sessions):
        yield f"the journal has {sessions} sessions, and {len(story.sessions)} are recorded"
    yield from (f"an attempt at {trial} has no end" for trial, _ in sorted(open_))


def tables(story: Story, files: Files) -> Iterator[str]:
    """Make the tables again from the journal, and compare them byte by byte."""
    made = Tables(Path(), story.given, story.services, story.rows).texts()
    for name, text in made.items():
        if content(files, name) != text.encode("utf-8", "replace"):
            yield f"{name} is not what follows from the journal"


def folders(story: Story, files: Files) -> Iterator[str]:
    """Look into the folder of each attempt: its row, and of one that counts all that it gave."""
    known = {attempt_folder(row) for row in story.ended}
    for row in story.ended:
        folder, session = attempt_folder(row), story.of.get(attempt_of(row))
        if f"{folder}/trial.json" in files.sizes and json_of(files, f"{folder}/trial.json") != row:
            yield f"{folder}/trial.json is not the row in the journal"
        if row.get("status") in COUNTED and session is not None:
            yield from _whole(session, row, folder, files)
    strange = {"/".join(name.split("/")[:2]) for name in files.sizes if name.startswith("trials/")} - known
    yield from (f"{folder} is of no attempt in the journal" for folder in sorted(strange))


def _whole(session: Session, row: Mapping[str, Any], folder: str, files: Files) -> Iterator[str]:
    wanted = [f"logs/{robot}.{service}.log" for service, robot in session.services.items()]
    for name in ("trial.json", "containers.json", "collected.json", *wanted):
        if f"{folder}/{name}" not in files.sizes:
            yield f"{folder}/{name} is missing"
    collected = f"{folder}/collected.json"
    if row.get("status") == "ok" and collected in files.sizes and json_of(files, collected).get("missing"):
        yield f"{folder}: a required result is missing, and it counts"


def counted(story: Story) -> str:
    """Return how attempts ended, in words, so that none is hidden."""
    counts: dict[str, int] = {}
    for row in story.rows:
        counts[string(row.get("status"))] = counts.get(string(row.get("status")), 0) + 1
    trials = len({trial.id for trial in story.last.design.trials})
    done = len({row.get("trial") for row in story.rows if row.get("status") in COUNTED})
    ended = ", ".join(f"{count} {status}" for status, count in sorted(counts.items()))
    return f"{done} of {trials} trials count; attempts: {ended or 'none'}"


def clocks(story: Story) -> str:
    """Return how well the robots' clocks are known, in words."""
    errors = [row["clock_error_ms"] for row in story.rows if isinstance(row.get("clock_error_ms"), int | float)]
    steps = sum(row.get("clock_step") is True for row in story.rows)
    without = sum(row.get("clock_error_ms") is None for row in story.rows)
    most = f"at most {max(errors):.1f} ms" if errors else "never known"
    return f"the error of clocks is {most}; {without} attempts without a measurement, {steps} with a clock that was set"


def _short(value: object) -> str:
    return str(value)[:80]
