"""The assignment problem as arrays: what the solvers work on.

Takes nothing of the world: integers only. Items are what can be placed: first every node alone (a service, or services
that must share a robot), then bundles (nodes whose pool runs together). A place is a slot of a robot. Wanted is a set
of (item, place) that covers every node once, uses a place at most once, keeps `anti_affinity`, and costs least. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

Array = Any
"""A numpy array; shapes and units are told where it stands."""
NEVER = 1 << 60
"""Stands for the cost of what is not allowed; far above every sum of costs, and twice it still fits 64 bits."""


class ProblemTable(msgspec.Struct, frozen=True, kw_only=True):
    """K items, the first N of them nodes; P places."""

    items: tuple[tuple[int, ...], ...]
    """K times the nodes (0..N-1) that the item covers; item j < N covers only node j."""
    nodes: int
    """N"""
    cost: Array
    """int64 [K, P], each at least 0; whatever where not allowed."""
    allowed: Array
    """bool [K, P]"""
    robots: Array
    """int64 [P]: the robot that each place belongs to."""
    anti_affinity: tuple[tuple[int, ...], ...] = ()
    """Sets of nodes of which a robot takes one at most; no item holds two of a set."""

    @property
    def plain(self) -> bool:
        """True when it is the paper's model: nodes, places, costs and nothing else, so a min-cost flow."""
        return len(self.items) == self.nodes and not self.anti_affinity

    def priced(self) -> Array:
        """Return int64 [K, P]: the costs, NEVER where not allowed."""
        return np.where(self.allowed, self.cost, NEVER)


class Selection(msgspec.Struct, frozen=True, kw_only=True):
    """The best that was found, and what is proved of it."""

    items: tuple[int, ...]
    """Chosen items, rising."""
    places: tuple[int, ...]
    """The place of each."""
    cost: int
    bound: int
    """No choice costs less."""

    @property
    def proved(self) -> bool:
        """True when nothing costs less."""
        return self.cost <= self.bound


def outcome(table: ProblemTable, items: Sequence[int], places: Sequence[int], bound: int | None = None) -> Selection:
    """Return an Outcome with its exact cost; without a bound it counts as proved."""
    pairs = sorted(zip(map(int, items), map(int, places), strict=True))
    cost = sum(int(table.cost[item, place]) for item, place in pairs)
    chosen, where = tuple(item for item, _ in pairs), tuple(place for _, place in pairs)
    return Selection(items=chosen, places=where, cost=cost, bound=cost if bound is None else min(bound, cost))


class Members:
    """Which nodes each item covers, as index arrays."""

    def __init__(self, items: Sequence[Sequence[int]], nodes: int) -> None:
        """Take the items of a Table."""
        self.nodes = nodes
        self.sizes: Array = np.array([len(item) for item in items], dtype=np.int64)
        self._flat: Array = np.array([node for item in items for node in item], dtype=np.int64)
        self._starts: Array = np.concatenate([[0], np.cumsum(self.sizes)])

    def sums(self, per_node: Array) -> Array:
        """Return [K]: the sum over each item's nodes of a value per node [N]."""
        return np.add.reduceat(per_node[self._flat], self._starts[:-1]) if len(self.sizes) else per_node[:0]

    def rows(self, chosen: Array) -> tuple[Array, Array]:
        """Return (node, position in `chosen`) of every node of the chosen items, for a sparse matrix."""
        sizes = self.sizes[chosen]
        column: Array = np.repeat(np.arange(len(chosen)), sizes)
        offset = np.arange(len(column)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return self._flat[self._starts[chosen][column] + offset], column
