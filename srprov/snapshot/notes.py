"""What of a robot could not be taken over as it is: a list of words with a subject each, of bounded length.

Takes texts of robots, gives values. Pure. What looks like a secret in them is hidden.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from srprov.snapshot.suspicion import masked
from srprov.untrusted import text

Kind = Literal["lost", "adapted", "secret"]
KINDS: tuple[Kind, ...] = ("lost", "adapted", "secret")
"""Not captured; captured by other means or with something to know; a value that nobody writes down."""
MOST = 400
"""Of each kind."""
_SUBJECT = 120
_WORDS = 400


class Note(msgspec.Struct, frozen=True):
    """One thing to know."""

    kind: Kind
    subject: str
    """`container db`, `repository /home/robot/ws` …"""
    words: str


@dataclass(slots=True)
class Notes:
    """The notes of one robot, as they are found."""

    robot: str = ""
    """Its name in the inventory."""
    found: list[Note] = field(default_factory=list)
    left_out: int = 0
    """Notes beyond the most that are kept."""
    _kept: Counter[Kind] = field(default_factory=Counter)
    _known: set[Note] = field(default_factory=set)

    def lost(self, subject: str, words: str) -> None:
        """Say that something was not captured."""
        self._add("lost", subject, words)

    def adapted(self, subject: str, words: str) -> None:
        """Say that something was captured in another way, or what is to be known of it."""
        self._add("adapted", subject, words)

    def secret(self, subject: str, words: str) -> None:
        """Say that a value looks like a secret, and what became of it; never the value."""
        self._add("secret", subject, words)

    def _add(self, kind: Kind, subject: str, words: str) -> None:
        if self._kept[kind] == MOST:  # before its words are looked through: a robot may give any number of them
            self.left_out += 1
            return
        note = Note(kind, masked(text(subject, length=_SUBJECT)), masked(text(words, length=_WORDS)))
        if note not in self._known:
            self._known.add(note)
            self._kept[kind] += 1
            self.found.append(note)

    def all(self) -> tuple[Note, ...]:
        """Return all of them; the last one says how many there are more."""
        more = (Note("lost", "report", f"{self.left_out} more things are not listed"),) if self.left_out else ()
        return (*self.found, *more)
