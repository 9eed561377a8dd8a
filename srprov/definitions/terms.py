"""One term of a host pattern -> hosts: a host, a group, `all`, a wildcard, `~regex`, a range, or a part of a group.

Takes an Inventory and terms without their signs. Pure. The terms of a list may be a stranger's, made for an inventory
of thousands of robots in many groups: what they cost is counted for all of them together, before it is done.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

from srprov import linear_regex
from srprov.codes import Code
from srprov.definitions import ranges
from srprov.definitions.model import Inventory
from srprov.errors import UsageError

_SUBSCRIPT = re.compile(r"(?P<name>.+)\[(?:(?P<one>-?[0-9]+)|(?P<first>[0-9]*)[:-](?P<last>[0-9]*))\]", re.ASCII)

_MOST_LOOKS = 5_000_000
"""Of all terms of a list, of 0.2 µs each: a wildcard against one name, or one member of a group that matched."""
_LOOKS_OF_REGEX, _LOOKS_OF_FOUND, _LOOKS_OF_RANGE, _LOOKS_OF_LETTER = 20, 40, 6, 50
"""What a regular expression costs for each name, and for each that it matches; what a name that a range stands for
costs, and a letter of a wildcard, which is made into an expression of Python's."""
_STEPS_OF_REGEX, _STEPS_OF_WILDCARD = 50, 100
"""Steps for one look: there are as many as a term's program has, or its letters, times those of all names."""
_LONGEST = 512
"""Of a list's terms that are no names and no regular expressions; no name with a range is longer."""


class TooMuchError(Exception):
    """All terms together would take too long."""


class _Names(NamedTuple):
    every: list[str]
    """Those of hosts, then those of groups."""
    letters: int


class Terms:
    """Finds the hosts of terms: of those that the user typed, or of a list's, which has one allowance for all."""

    def __init__(self, inventory: Inventory, *, listed: bool = False) -> None:
        """Begin; regular expressions of a list are RE2's, as it may be a stranger's."""
        self._inventory = inventory
        self._checked = linear_regex.Patterns() if listed else None
        self._left = _MOST_LOOKS

    def hosts(self, term: str) -> set[str]:
        """Return the hosts of a term, none where it matches nothing.

        Raises:
            UsageError: It is no term.
            TooMuchError: It is too much with those before.
        """
        if term.startswith("~"):
            return self._regex(term[1:])
        if found := self._wildcard(term):
            return found
        match = _SUBSCRIPT.fullmatch(term)
        if match is not None and (base := self._wildcard(match["name"])):
            self._take(_LOOKS_OF_RANGE * len(base))
            return set(_part(sorted(base), match))
        try:
            count, names = ranges.count_and_names(term)
        except ValueError as error:
            raise UsageError(str(error), code=Code.OPTION_VALUE) from None
        self._take(_LOOKS_OF_RANGE * count)
        return {name for name in names if name in self._inventory.hosts}

    @cached_property
    def _names(self) -> _Names:
        groups = (name for name in self._inventory.groups if name not in ("all", "ungrouped"))
        every = [*self._inventory.hosts, *groups]
        return _Names(every, sum(len(name.encode("utf-8", "surrogatepass")) for name in every))

    def _take(self, looks: int) -> None:
        if self._checked is None:
            return
        self._left -= looks
        if self._left < 0:
            raise TooMuchError

    def _regex(self, pattern: str) -> set[str]:
        try:
            regex: Any = self._checked.compiled(pattern) if self._checked else re.compile(pattern)
        except (re.error, ValueError) as error:
            raise UsageError(f"'{pattern}' is not a regular expression: {error}", code=Code.OPTION_VALUE) from None
        if self._checked:
            steps = self._names.letters * regex.programsize
            self._take(_LOOKS_OF_REGEX * len(self._names.every) + steps // _STEPS_OF_REGEX)
        return self._fitting(regex.match, _LOOKS_OF_FOUND)

    def _wildcard(self, term: str) -> set[str]:
        hosts, groups = self._inventory.hosts, self._inventory.groups
        if term in ("all", "*"):
            self._take(len(hosts))
            return set(hosts)
        if term in hosts or term in groups:
            members = groups.get(term, ())
            self._take(1 + len(members))
            return {term, *members} if term in hosts else set(members)
        if self._checked and len(term) > _LONGEST:
            raise UsageError(f"'{term[:60]}…' is longer than {_LONGEST} characters", code=Code.OPTION_VALUE)
        if "[" in term or not set("*?") & set(term):
            return set()
        steps = self._names.letters * len(term)
        self._take(_LOOKS_OF_LETTER * len(term) + len(self._names.every) + steps // _STEPS_OF_WILDCARD)
        return self._fitting(re.compile(fnmatch.translate(term)).match, 0)

    def _fitting(self, fits: Callable[[str], object], looks: int) -> set[str]:
        """Return the hosts whose names fit, and those of groups whose names do; `looks` is what each of these costs."""
        found: set[str] = set()
        hosts = len(self._inventory.hosts)
        for number, name in enumerate(self._names.every):
            if not fits(name):
                continue
            if number < hosts:
                self._take(1 + looks)
                found.add(name)
            else:
                members = self._inventory.groups[name]
                self._take(1 + looks + len(members))
                found.update(members)
        return found


def _part(hosts: list[str], match: re.Match[str]) -> list[str]:
    """Return one host of a group by position, or a stretch, whose end counts too."""
    if match["one"] is not None:
        index = int(match["one"])
        return hosts[index : index + 1 or None] if -len(hosts) <= index < len(hosts) else []
    last = int(match["last"]) + 1 if match["last"] else None
    return hosts[int(match["first"] or 0) : last]
