"""How two runs compare: grades, and the lines and sections that have them. Pure."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

IDENTICAL, EQUIVALENT, UNKNOWN, INCONCLUSIVE, DIFFERENT = (
    "identical",
    "equivalent",
    "unknown",
    "inconclusive",
    "different",
)
GRADES = (IDENTICAL, EQUIVALENT, UNKNOWN, INCONCLUSIVE, DIFFERENT)
"""From the best to the worst. Equivalent: it differs, and the rule says that this does not matter; unknown: one side
has not recorded it, or nobody said how much may differ."""


class Line(msgspec.Struct, frozen=True):
    """One thing that was compared."""

    subject: str
    grade: str
    text: str = ""


class Section(msgspec.Struct, frozen=True, kw_only=True):
    """Things of one kind."""

    id: str
    what: str
    decides: bool
    """Whether the answer depends on it."""
    lines: tuple[Line, ...]

    @property
    def grade(self) -> str:
        """Return the worst grade of its lines; of none, that nothing is known."""
        return worst(one.grade for one in self.lines) if self.lines else UNKNOWN


def worst(grades: Iterable[str]) -> str:
    """Return the worst of several grades, of which there must be one."""
    return max(grades, key=GRADES.index)


def answer(sections: Iterable[Section]) -> str:
    """Return the grade of a whole comparison: the worst of what decides; what is unknown decides nothing."""
    grade = worst(one.grade for one in sections if one.decides)
    return INCONCLUSIVE if grade == UNKNOWN else grade
