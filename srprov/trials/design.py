r"""Parameters and repetitions -> the trials, each with an id and a seed, in the order in which they are run.

A trial's id and seed follow from its parameters' values and the number of its repetition alone, and random order is an
order by hash. So all of it is the same on every machine, another program can find it again, and a further value or
repetition changes no trial that is there already:

    point    first 10 hex digits of sha256("srprov-point/1\n" + the parameters as JSON, names sorted, no spaces, UTF-8)
    trial    point + "-r" + the repetition, counted from 1, in three digits
    seed     first 8 hex digits of sha256("srprov-seed/1|ROOT|POINT|REPETITION"), without the highest bit: 31 bits fit
             everywhere; POINT is empty when all trials of a repetition share a seed
    order    repetition by repetition, points by sha256("srprov-order/1|ROOT|REPETITION|POINT")
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping

import msgspec

from srprov.codes import Code
from srprov.definitions.trialpoints import MOST_TRIALS, combinations, most_points
from srprov.definitions.trialsmodel import TrialDefinitions, TrialSettings
from srprov.errors import UsageError

_POINT_DIGITS = 10


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """One combination of the parameters' values."""

    id: str
    values: Mapping[str, str]
    """Parameter -> its value as text."""


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One repetition of a point."""

    id: str
    point: Point
    repetition: int
    """Counted from 1."""
    seed: int
    """0 to 2**31 - 1"""


class Design(msgspec.Struct, frozen=True, kw_only=True):
    """All trials of an experiment."""

    points: tuple[Point, ...]
    """As listed."""
    trials: tuple[Trial, ...]
    """In the order in which they are run."""


def design(given: TrialDefinitions) -> Design:
    """Return the trials that an EDF asks for.

    Raises:
        UsageError: There are too many, or none; or two points have one id.
    """
    settings = given.settings
    count = most_points(given) * settings.repetitions
    if count > MOST_TRIALS:
        raise UsageError(
            f"{count} trials are more than {MOST_TRIALS}",
            hint="give fewer values or repetitions",
            code=Code.TRIAL_DESIGN,
        )
    points = _points(given)
    if not points:
        raise UsageError("no trial is left: 'exclude' takes all points away", code=Code.TRIAL_DESIGN)
    known: dict[str, Point] = {}
    for point in points:
        if known.setdefault(point.id, point) is not point:
            raise UsageError(
                f"two points have the id {point.id}", hint="change a value, however little", code=Code.TRIAL_DESIGN
            )
    trials = [
        _trial(point, repetition, settings)
        for repetition in range(1, settings.repetitions + 1)
        for point in _ordered(points, repetition, settings)
    ]
    return Design(points=points, trials=tuple(trials))


def _points(given: TrialDefinitions) -> tuple[Point, ...]:
    every = {json.dumps(one, sort_keys=True): one for one in (*combinations(given), *map(dict, given.settings.include))}
    return tuple(Point(id=point_id(values), values=values) for values in every.values())


def point_id(values: Mapping[str, str]) -> str:
    """Return the id of a combination of values."""
    text = json.dumps(dict(values), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return _sha256(f"srprov-point/1\n{text}")[:_POINT_DIGITS]


def _trial(point: Point, repetition: int, settings: TrialSettings) -> Trial:
    whose = "" if settings.paired_seeds else point.id
    digits = _sha256(f"srprov-seed/1|{settings.seed}|{whose}|{repetition}")[:8]
    return Trial(
        id=f"{point.id}-r{repetition:03d}", point=point, repetition=repetition, seed=int(digits, 16) & 0x7FFFFFFF
    )


def _ordered(points: tuple[Point, ...], repetition: int, settings: TrialSettings) -> Iterable[Point]:
    if settings.order == "listed":
        return points
    return sorted(points, key=lambda one: _sha256(f"srprov-order/1|{settings.seed}|{repetition}|{one.id}"))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
