"""Two runs, or two sides of several -> what is the same, what is not, and what nobody can tell.

Takes paths of run folders and bundles; gives a Comparison. Offline, without robots; nothing of a run is executed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.trialsmodel import Margin
from srprov.errors import UsageError, visible
from srprov.evidence import compare_images, compare_inputs, compare_outcomes, compare_runs, grades
from srprov.evidence.compare_outcomes import SUCCESS, Judging
from srprov.evidence.compare_runs import Run
from srprov.evidence.grades import Line, Section
from srprov.evidence.verified import Bundle

_MOST_LINES = 100
"""Of one section: each file of an experiment may have one."""
_LONGEST = 600
_SECTIONS: tuple[tuple[str, str, bool, Callable[[Run, Run], Iterable[Line]]], ...] = (
    ("definitions", "what was to be run", True, compare_inputs.definitions),
    ("images", "what containers are made of", True, compare_images.images),
    ("placement", "which robot ran what", True, compare_inputs.placement),
    ("execution", "which trials were run", True, compare_outcomes.execution),
    ("robots", "what robots are", False, compare_inputs.robots),
    ("clocks", "how well robots' clocks were known", False, compare_inputs.clocks),
    ("results", "files that trials left", False, compare_outcomes.results),
)


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """What came of it."""

    sections: tuple[Section, ...]
    notes: tuple[str, ...]
    """What is to be known when it is read."""

    @property
    def answer(self) -> str:
        """Return `identical`, `equivalent`, `different` or `inconclusive`."""
        return grades.answer(self.sections)


def compare(
    a: Sequence[str], b: Sequence[str], margins: Mapping[str, Margin], only: Collection[str] = (),
    verified: Collection[Bundle] = (),
) -> Comparison:  # fmt: skip
    """Compare two sides.

    Args:
        a: Run folders and bundles of one side.
        b: Of the other one.
        margins: Metric -> how much it may differ; `success` is the share of trials with that verdict.
        only: Trials and points that are compared; empty: all.
        verified: Bundles among them that were verified before, and are read as they were then.

    Raises:
        UsageError: A run cannot be read, or no run has a metric that a margin names.
    """
    with compare_runs.read([*a, *b], only, verified) as runs:
        here, there = runs[: len(a)], runs[len(a) :]
        _check(margins, runs)
        sections = [_section(*one, runs) for one in _SECTIONS]
        measured = tuple(map(_visible, Judging(here, there, margins).lines()))
        if measured:
            what = "what was measured; intervals are of 90 %"
            sections.append(Section(id="metrics", what=what, decides=True, lines=measured))
        return Comparison(sections=tuple(sections), notes=tuple(_notes(here, there)))


def _check(margins: Mapping[str, Margin], runs: Sequence[Run]) -> None:
    for run in runs:
        known = {one.name for one in run.story.given.metrics} | {SUCCESS}
        if unknown := sorted(margins.keys() - known):
            hint = f"it has {', '.join(sorted(known))}"
            raise UsageError(f"{run.name} has no metric {', '.join(unknown)}", hint=hint, code=Code.NO_SUCH_NAME)


def _section(
    name: str,
    what: str,
    decides: bool,
    lines: Callable[[Run, Run], Iterable[Line]],
    runs: Sequence[Run],
) -> Section:
    """Compare all other runs with the first; where there are several, each line says which one it is of."""
    found: list[Line] = []
    for other in runs[1:]:
        for line in lines(runs[0], other):
            found.append(line if len(runs) == 2 else replace(line, subject=f"{other.name}: {line.subject}"))
    found.sort(key=lambda one: -grades.GRADES.index(one.grade))
    more = len(found) - _MOST_LINES
    kept = [_visible(one) for one in found[:_MOST_LINES]]
    if more > 0:
        kept.append(Line("more", found[_MOST_LINES].grade, f"{more} lines"))
    return Section(id=name, what=what, decides=decides, lines=tuple(kept))


def _visible(line: Line) -> Line:
    """Return a line that a terminal can show: its words may be a stranger's."""
    return Line(visible(line.subject[:_LONGEST]), line.grade, visible(line.text[:_LONGEST]))


def _notes(a: Sequence[Run], b: Sequence[Run]) -> Iterable[str]:
    if a[0].only:
        yield f"only {len(a[0].trials)} of {len(a[0].story.last.design.trials)} trials are compared, as asked for"
    if len(a) == len(b) == 1:
        yield (
            "how much runs differ from one day to the next is not known from one run a side: what is not interleaved "
            "differs more than its trials say (compare several runs a side, or make the variant a parameter of one run)"
        )
    yield "where robots stood, light, floor, batteries and people are not recorded"
