"""Costs and prices of every (item, place) pair, in whole numbers finer than the costs' own unit. Pure.

Takes a ProblemTable; `PricedPairs` gives flows of chosen items, and bounds that prices prove.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from srprov.assignment.rows import ConstraintRows, disjoint
from srprov.assignment.solve_flow import assign, potentials
from srprov.assignment.table import NEVER, Array, Members, ProblemTable

_FINER = 4096
"""Prices are whole numbers of 1/4096 unit, so that rounding them costs less than a unit of the bound."""
_ROUNDS = 60
"""Of Bellman-Ford for the first prices, which need not be exact."""


@dataclass(kw_only=True)
class Prices:
    """Dual values in fine units, whole numbers: u [N], v [P] <= 0, w [anti-affinity rows] <= 0; and their bound."""

    u: Array
    v: Array
    w: Array
    bound: int


@dataclass
class PricedPairs:
    """Every pair with its cost; the last place is nowhere."""

    table: ProblemTable
    members: Members = field(init=False)
    fine: int = field(init=False)
    """Fine units in one unit of the table's costs."""
    nowhere: int = field(init=False)
    """Fine units."""
    rows: ConstraintRows = field(init=False)
    cost: Array = field(init=False)
    """int64 [K, P + 1] in fine units."""

    def __post_init__(self) -> None:
        """Lay out costs and rows."""
        table = self.table
        items, places = table.cost.shape
        largest = int(table.cost[table.allowed].max(initial=0)) * max(1, table.nodes) + 1
        self.fine = max(1, min(_FINER, NEVER // (8 * max(1, table.nodes) * largest)))
        self.nowhere = largest * self.fine
        self.members = Members(table.items, table.nodes)
        self.rows = ConstraintRows(table)
        self.cost = np.full((items, places + 1), NEVER, dtype=np.int64)
        self.cost[:, :places] = np.where(table.allowed, table.cost * self.fine, NEVER)
        self.cost[: table.nodes, places] = self.nowhere

    def flow(self, chosen: Array) -> tuple[Array, Array, Array]:
        """Place items that cover every node, without anti-affinity: the place of each, and their prices u and v [P]."""
        places = self.cost.shape[1] - 1
        own: Array = np.full((len(chosen), len(chosen)), NEVER, dtype=np.int64)
        np.fill_diagonal(own, self.nowhere * self.members.sizes[chosen])
        cost = np.hstack([self.cost[chosen, :places], own])
        found = assign(cost, cost < NEVER)
        assert found is not None, "everything can go nowhere"
        u, v = potentials(cost, found, _ROUNDS)
        return np.minimum(found, places), u, v[:places]

    def gainful(self, u: Array, v: Array) -> list[int]:
        """Return disjoint bundles in the order of what they gain under prices."""
        nodes = self.table.nodes
        priced = np.minimum(self.cost[nodes:, :-1], NEVER // 4) - v
        gains = priced.min(axis=1, initial=NEVER // 4) - self.members.sums(u)[nodes:]
        order = [nodes + int(index) for index in np.argsort(gains, kind="stable") if gains[index] < 0]
        return disjoint(order, self.table)

    def split(self, chosen: Array, per_item: Array, v: Array) -> Array:
        """Return prices per node [N] from those per chosen item; a bundle's is split by what its nodes would cost."""
        alone = np.minimum(self.cost[: self.table.nodes, :-1], NEVER // 4) - v
        u = np.minimum(alone.min(axis=1, initial=self.nowhere), self.nowhere)
        for item, price in zip(chosen.tolist(), per_item.tolist(), strict=True):
            inside = list(self.table.items[item])
            total = int(u[inside].sum())
            u[inside] = (
                (u[inside] * (price / total)).astype(np.int64) if item >= self.table.nodes and total else u[inside]
            )
        return u

    def prove(self, u: Array, w: Array) -> Prices:
        """Return the best bound that prices per node and per anti-affinity row allow, with the prices that prove it."""
        u = np.minimum(u, self.nowhere)
        w = np.minimum(w, 0).astype(np.int64)
        v = np.minimum(0, self.reduced(u, np.zeros(self.cost.shape[1] - 1, dtype=np.int64), w)[:, :-1].min(axis=0))
        return Prices(u=u, v=v, w=w, bound=int(u.sum()) + int(v.sum()) + self.rows.worth(w))

    def reduced(self, u: Array, v: Array, w: Array) -> Array:
        """Return int64 [K, P + 1]: the reduced cost of every pair."""
        reduced = self.cost - self.members.sums(u)[:, None]
        reduced[:, :-1] -= v
        self.rows.subtract(reduced, w)
        return reduced

    def nowhere_pairs(self) -> Array:
        """Return the pair of every node with nowhere."""
        return np.arange(self.table.nodes) * self.cost.shape[1] + self.cost.shape[1] - 1
