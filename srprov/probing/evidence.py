"""All that is known of a round in which something failed: what was measured, and what robots showed. Pure.

What is looked up for every pair is put in order once: of a thousand services there are tens of thousands of pairs.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from srprov.probing.firewall import Rule
from srprov.probing.look import Inside, Look
from srprov.probing.model import GATEWAY, UNDERLAY, Endpoint, Round
from srprov.probing.pairs import Pair


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """All that is known when something fails."""

    found: Round
    pairs: tuple[Pair, ...]
    looks: Mapping[str, Look]
    """Robot -> what is there, after the round."""
    dropped: Mapping[str, Sequence[Rule]] = field(default_factory=dict)
    """Robot -> rules that met packets during the round."""

    def namespace(self, endpoint: Endpoint) -> Inside | None:
        """Return what was seen in an endpoint's network namespace."""
        look = self.looks.get(endpoint.robot)
        if look is None or not endpoint.container:
            return look.host if look else None
        return look.inside.get(self._places[endpoint])

    def vtep(self, robot: str) -> str:
        """Return a robot's underlay address."""
        return self._addresses[UNDERLAY].get(robot, "")

    def end(self, robot: str) -> str:
        """Return where forwarding entries for a robot lead: to its underlay address; encrypted, to its gateway's."""
        return self._addresses[GATEWAY if self.found.request.tunnel_port else UNDERLAY].get(robot, "")

    def under(self, source: str, target: str) -> Pair | None:
        """Return what one robot measured of another on the underlay."""
        return self._under.get((source, target))

    @cached_property
    def _places(self) -> dict[Endpoint, int]:
        return {one: at for at, one in enumerate(self.found.request.endpoints)}

    @cached_property
    def _addresses(self) -> dict[str, dict[str, str]]:
        every = self.found.request.endpoints
        return {kind: {one.robot: one.address for one in every if one.kind == kind} for kind in (GATEWAY, UNDERLAY)}

    @cached_property
    def _under(self) -> dict[tuple[str, str], Pair]:
        return {(one.source.robot, one.target.robot): one for one in self.pairs if one.source.kind == UNDERLAY}


def by_end(pairs: Iterable[Pair]) -> dict[str, list[Pair]]:
    """Return name of an endpoint -> the pairs that it is part of."""
    found: dict[str, list[Pair]] = {}
    for one in pairs:
        for name in one.names:
            found.setdefault(name, []).append(one)
    return found
