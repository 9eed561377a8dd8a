"""Which changing resources another one needs, through unchanged ones, however many. Pure."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping

from srprov.codes import Code
from srprov.errors import PlanError
from srprov.resource import Need, Resource

_MOST = 2_000_000
"""Needs that are followed for a plan beyond twice those that there are; experiments follow each about once."""


class Reach:
    """The resources of one plan."""

    def __init__(self, wanted: Mapping[str, Resource], changed: Container[str]) -> None:
        """Take all resources by id, and the ids of those that change."""
        self._wanted, self._changed = wanted, changed
        self._left = _MOST + 2 * sum(len(one.needs) for one in wanted.values())

    def of(self, needs: Iterable[Need]) -> set[str]:
        """Return the ids of changing resources that `needs` lead to.

        Raises:
            PlanError: All those of the plan together lead over too many others.
        """
        reached, seen, left = set(), set(), list(needs)
        self._left -= len(left)
        while left:
            need = left.pop()
            if need.id in seen:
                continue
            seen.add(need.id)
            if need.id in self._changed:
                reached.add(need.id)
            elif need.id in self._wanted:
                more = self._wanted[need.id].needs
                self._left -= len(more)
                left.extend(more)
            if self._left < 0:
                raise PlanError(
                    "its resources need each other in too many ways",
                    hint="let them need fewer others",
                    code=Code.TOO_LARGE,
                )
        return reached
