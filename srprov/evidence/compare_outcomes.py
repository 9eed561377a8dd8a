"""What came of two sides: which trials were run, what they left, what they measured. Takes runs; gives lines. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from msgspec.structs import replace

from srprov.definitions.trialsmodel import Margin
from srprov.evidence import effects
from srprov.evidence.compare_runs import Run
from srprov.evidence.effects import Effect, TooFew
from srprov.evidence.files import NotThere, json_of
from srprov.evidence.grades import DIFFERENT, EQUIVALENT, IDENTICAL, INCONCLUSIVE, UNKNOWN, Line
from srprov.evidence.story import attempt_folder
from srprov.trials.power import FEWEST_TRIALS
from srprov.untrusted import mapping, mappings, string

SUCCESS = "success"
"""What a margin calls the share of trials with that verdict."""
_MOST_SHOWN = 5
_MOST_FILES = 250_000
_P = 0.05
Side = Sequence[Run]


def execution(a: Run, b: Run) -> Iterator[Line]:
    """Compare which trials were run, with which seeds, in which order, and whether all of them count."""
    here, there = ([trial.id for trial in run.trials] for run in (a, b))
    if set(here) != set(there):
        for run, only in ((a, set(here) - set(there)), (b, set(there) - set(here))):
            if only:
                yield Line("trials", DIFFERENT, f"{len(only)} only in {run.name}: {_some(only)}")
    elif here != there:
        yield Line("trials", EQUIVALENT, f"the same {len(here)}, in another order")
    else:
        yield Line("trials", IDENTICAL, f"the same {len(here)}, in the same order")
    seeds = [{trial.id: trial.seed for trial in run.trials} for run in (a, b)]
    both = seeds[0].keys() & seeds[1].keys()
    other = {one for one in both if seeds[0][one] != seeds[1][one]}
    yield Line("seeds", DIFFERENT if other else IDENTICAL, f"of {len(other)} trials: {_some(other)}" if other else "")
    for run, wanted in ((a, here), (b, there)):
        missing = set(wanted) - {string(row.get("trial")) for row in run.counted}
        text = f"{len(missing)} of {len(wanted)} trials do not count: {_some(missing)}" if missing else "all count"
        yield Line(run.name, DIFFERENT if missing else IDENTICAL, text)


def _some(names: set[str]) -> str:
    return ", ".join(sorted(names)[:_MOST_SHOWN]) + ", …" * (len(names) > _MOST_SHOWN)


def results(a: Run, b: Run) -> Iterator[Line]:
    """Compare the files that trials left, by the hashes that their robots gave."""
    here, there = (dict(_left(run)) for run in (a, b))
    both = here.keys() & there.keys()
    if not both:
        return
    names = [one for one in both if here[one].keys() != there[one].keys()]
    contents = [one for one in both if here[one] != there[one]]
    if names:
        yield Line("files", DIFFERENT, f"{len(names)} of {len(both)} trials left other files: {_some(set(names))}")
    elif contents:
        yield Line("files", EQUIVALENT, f"{len(contents)} of {len(both)} trials left files of the same names alone")
    else:
        yield Line("files", IDENTICAL, f"of {len(both)} trials")


def _left(run: Run) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Return trial -> result -> sha256."""
    for row in run.counted:
        try:
            listed = mapping(json_of(run.files, f"{attempt_folder(row)}/collected.json").get("results"))
        except NotThere:
            continue
        yield (
            string(row.get("trial")),
            {
                f"{key}/{string(one.get('path'))}": string(one.get("sha256"))
                for key, some in listed.items()
                for one in mappings(some, most=_MOST_FILES)
            },
        )


@dataclass(slots=True)
class Judging:
    """Metrics of two sides, and the p values of those that differ: several tests find something by chance."""

    a: Side
    b: Side
    margins: Mapping[str, Margin]
    chances: dict[str, float] = field(default_factory=dict)

    def lines(self) -> Iterator[Line]:
        """Compare each metric, and the share of successes."""
        found = [*map(self._metric, self._names()), *self._successes()]
        adjusted = effects.holm(self.chances)
        for line in found:
            p = adjusted.get(line.subject, 0.0)
            note = f"; it may be chance, among {len(adjusted)} metrics: p {p:.2g} (Holm)" if p > _P else ""
            yield replace(line, text=line.text + note)

    def _names(self) -> list[str]:
        """Return the metrics that all runs have, in the order of the first."""
        of = [[one.name for one in run.story.given.metrics] for run in (*self.a, *self.b)]
        return [name for name in of[0] if all(name in names for names in of[1:])]

    def _unit(self, name: str) -> str:
        return next((one.unit for one in self.a[0].story.given.metrics if one.name == name), "")

    def _margin(self, name: str) -> Margin | None:
        """Return the margin that was asked for, or else the one of the first run's experiment."""
        stated = (one.margin for one in self.a[0].story.given.metrics if one.name == name)
        return self.margins.get(name) or next(stated, None)

    def _metric(self, name: str) -> Line:
        margin = self._margin(name)
        of_a, of_b = ([run.values(name) for run in side] for side in (self.a, self.b))
        if len(of_a) == len(of_b) == 1 and of_a[0] == of_b[0] and of_a[0]:
            return Line(name, IDENTICAL, f"in each of {sum(map(len, of_a[0].values()))} trials")
        every = [value for one in (*of_a, *of_b) for trials in one.values() for value in trials.values()]
        ratio = bool(margin and margin.relative and every and min(every) > 0)
        several = len(of_a) > 1 or len(of_b) > 1
        here, there = (_means(one, ratio=ratio) if several else _trials(one[0]) for one in (of_a, of_b))
        means = "; ".join(f"{side} {_summary(one)}" for side, one in (("A", of_a), ("B", of_b)))
        head = f"{means}{' ' + self._unit(name) if self._unit(name) else ''}"
        try:
            fewest = effects.FEWEST_RUNS if several else FEWEST_TRIALS
            found = effects.effect(here, there, ratio=ratio and not several, fewest=fewest)
        except TooFew as error:
            return Line(name, UNKNOWN, f"{head}; {error}")
        if several and ratio:  # the means are of logarithms already
            found = replace(found, ratio=True)
        return self._judged(name, found, head, margin, _mean(here))

    def _judged(self, name: str, found: Effect, head: str, margin: Margin | None, mean_a: float) -> Line:
        text = f"{head}; B - A {found.text}"
        if margin is None:
            return Line(name, UNKNOWN, f"{text}; nobody said how much may differ ({self._how(name)})")
        within = effects.bounds(margin, found, mean_a)
        grade = effects.judged(found, within)
        text += f", margin {margin.text}" + ("" if name in self.margins else " of the EDF")
        if grade == DIFFERENT:
            self.chances[name] = effects.chance(found, within)
        if grade == INCONCLUSIVE and within[0] < found.estimate < within[1]:
            text += f"; about {effects.needed(found, within)} times as many would settle it"
        return Line(name, grade, text)

    def _how(self, name: str) -> str:
        return f"--margin {name}=…" + ("" if name == SUCCESS else ", or `margin` of the metric in the EDF")

    def _successes(self) -> list[Line]:
        of = [[row.get("verdict") for run in side for row in run.counted] for side in (self.a, self.b)]
        if not all(any(verdicts) for verdicts in of):
            return []
        counts = [(sum(one == SUCCESS for one in verdicts), len(verdicts)) for verdicts in of]
        head = f"A {counts[0][0]} of {counts[0][1]}; B {counts[1][0]} of {counts[1][1]}"
        verdicts = [
            {row.get("trial"): row.get("verdict") for run in side for row in run.counted} for side in (self.a, self.b)
        ]
        if len(self.a) == len(self.b) == 1 and verdicts[0] == verdicts[1]:
            return [Line(SUCCESS, IDENTICAL, head)]
        try:
            found = effects.shares(*counts)
        except TooFew as error:
            return [Line(SUCCESS, UNKNOWN, f"{head}; {error}")]
        return [self._judged(SUCCESS, found, head, self.margins.get(SUCCESS), 1.0)]


def _trials(values: Mapping[str, Mapping[str, float]]) -> dict[str, list[float]]:
    return {point: list(trials.values()) for point, trials in values.items()}


def _means(runs: Sequence[Mapping[str, Mapping[str, float]]], *, ratio: bool) -> dict[str, list[float]]:
    """Return the mean of each run over the points that all of them have; of logarithms, for a ratio."""
    points = set(runs[0]).intersection(*runs[1:])
    means = [
        fmean(fmean(math.log(one) if ratio else one for one in run[point].values()) for point in sorted(points))
        for run in runs
        if points
    ]
    return {"": means}


def _mean(values: Mapping[str, Sequence[float]]) -> float:
    return fmean(fmean(one) for one in values.values() if one)


def _summary(runs: Sequence[Mapping[str, Mapping[str, float]]]) -> str:
    every = [value for run in runs for trials in run.values() for value in trials.values()]
    return f"{fmean(every):.4g} (n {len(every)})" if every else "none"
