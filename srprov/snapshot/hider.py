"""Texts without the values that became secrets.

Takes values and texts, gives texts. Pure. A long value is hidden in every form that `redaction` knows, wherever it
stands. A short one, which may be a usual word (`robot`), is hidden where it stands by itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from srprov.redaction import MASK, Known, forms

LONG = 8
"""Characters of a value that no usual word is."""
MOST = 1000
"""Values of an experiment."""
MOST_CHARACTERS = 256 << 10
"""Of all of them: each is looked for in some sixty forms."""
_SHORTEST = 3


class Hider:
    """The values of one experiment; it never changes."""

    def __init__(self, values: Iterable[str]) -> None:
        """Know these values.

        Raises:
            ValueError: There are too many, or they are too long.
        """
        every = sorted({value for value in values if value.strip()})
        if len(every) > MOST or sum(map(len, every)) > MOST_CHARACTERS:
            raise ValueError(f"more than {MOST} values, or {MOST_CHARACTERS >> 10} KiB of them, look like secrets")
        self.strong = tuple(value for value in every if len(value.strip()) >= LONG)
        self._known = Known({value: forms(value) for value in self.strong})
        weak = [re.escape(value.strip()) for value in every if _SHORTEST <= len(value.strip()) < LONG]
        longest_first = "|".join(sorted(weak, key=len, reverse=True))
        self._weak = re.compile(rf"(?<![\w./-])(?:{longest_first})(?![\w./-])") if weak else None

    def without(self, text: str) -> str:
        """Return a text of a robot without any of them."""
        clean = self.without_strong(text)
        return self._weak.sub(MASK, clean) if self._weak else clean

    def without_strong(self, text: str) -> str:
        """Return a text of our own, in which usual words stand, without the long ones."""
        return self._known.without(text) if self._known else text
