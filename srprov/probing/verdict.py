"""What came of probing an instance: two rounds and looks at most, judged. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

from srprov.probing import causes, on_robots
from srprov.probing.document import document
from srprov.probing.evidence import Evidence
from srprov.probing.firewall import that_dropped
from srprov.probing.look import Look
from srprov.probing.model import UNDERLAY, Round
from srprov.probing.pairs import Pair, pairs_of

JUDGES = (
    on_robots.of_links,
    on_robots.of_addresses,
    on_robots.of_neighbours,
    on_robots.of_entries,
    causes.of_narrow_links,
    on_robots.of_firewalls,
    causes.on_underlay,
    causes.of_size,
    causes.of_pattern,
)
"""In this order: what is seen on a robot says more than a pattern does."""


def fails(found: Round) -> bool:
    """Return whether a pair of the overlay failed, or somebody could not even ask."""
    return any(one.failed and one.source.kind != UNDERLAY for one in pairs_of(found)) or any(
        one.failed for one in found.said.values()
    )


@dataclass(frozen=True, kw_only=True)
class Probed:
    """What was asked last, and what was seen before and after it."""

    found: Round
    before: Mapping[str, Look] = field(default_factory=lambda: MappingProxyType({}))
    """Robot -> a look; empty when everything worked at once."""
    after: Mapping[str, Look] = field(default_factory=lambda: MappingProxyType({}))
    seconds: float = 0.0

    @cached_property
    def pairs(self) -> tuple[Pair, ...]:
        """Return every pair that was asked."""
        return pairs_of(self.found)

    @cached_property
    def causes(self) -> tuple[causes.Cause, ...]:
        """Return what fails and why, and entries that are wrong where that was looked at."""
        dropped = {
            robot: that_dropped(self.before[robot].rules, look.rules)
            for robot, look in self.after.items()
            if robot in self.before
        }
        evidence = Evidence(found=self.found, pairs=self.pairs, looks=self.after, dropped=dropped)
        return causes.judged(evidence, JUDGES)

    @property
    def works(self) -> bool:
        """Return whether nothing of the overlay is wrong between those who took part."""
        return not self.causes

    def json(self) -> dict[str, Any]:
        """Return the documented JSON (`srprov schema probe`)."""
        return document(self.found, self.pairs, [causes.cause_json(one) for one in self.causes], self.seconds)
