"""Pools and relations: the exact method where the flow alone is not the model.

Takes a ProblemTable, gives a Selection, or None when not every node can be covered. Pure and deterministic (a time
limit can cut it short; then the Selection says by how much it may be off).

What makes it fast is that hardly any of the (item, place) pairs matter:

1. The nodes' own min-cost flow gives prices to begin with; bundles that gain most under them give a first choice.
2. The linear relaxation is solved on a few pairs each; all others are priced by arrays, those with negative reduced
   cost join (column generation), until none is left.
3. Prices give a bound that is checked in whole numbers, whatever the solver's rounding: with u per node, v <= 0 per
   place and w <= 0 per anti-affinity row such that no pair's reduced cost is negative, `sum u + sum v + sum w` is below
   every choice's cost.
4. Where bundles are chosen by halves, inequalities that every choice keeps are added (`cuts`), and 2 goes on.
5. A choice that beats the best known one holds only pairs whose reduced cost is at most the gap. So HiGHS gets these
   alone, and its optimum is the optimum of all. Mostly the relaxation is whole already, and nothing is left to do.

A node may also go nowhere, at a cost above any full choice: so everything stays feasible, and a best choice with a node
nowhere proves that there is none.

Source: column generation and reduced-cost fixing, e.g. Wolsey, *Integer Programming*, 2nd ed., chapters 7 and 11.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from srprov.assignment.cuts import odd_cycles
from srprov.assignment.pool_prices import PricedPairs, Prices
from srprov.assignment.rows import disjoint, smallest
from srprov.assignment.solve_lp import Growing, whole
from srprov.assignment.table import NEVER, Array, ProblemTable, Selection, outcome

_AWAY = 4.0
"""What nowhere costs in the relaxation to begin with, in largest costs; more only if it is still chosen then."""
_MOST_CUTS = 1000
_PER_ITEM, _PER_PLACE = 8, 4
"""Pairs that begin, and that join at a time."""


def solve_table(table: ProblemTable, seconds: float | None = None) -> Selection | None:
    """Return the cheapest cover, or None; with a limit in seconds the best found by then and its bound."""
    if not table.nodes:
        return outcome(table, (), ())
    search = _Search(table, None if seconds is None else time.monotonic() + seconds)
    search.begin()
    search.relax()
    search.finish()
    return search.answer()


@dataclass
class _Search(PricedPairs):
    """The state between the steps: pairs in the relaxation, the best prices, the best choice."""

    until: float | None = None
    """By time.monotonic(); None: no limit."""
    best: tuple[int, Array] | None = None
    """Fine cost of the best choice so far, and its pairs."""
    prices: Prices | None = None
    bound: int = 0
    """Fine units: no choice costs less."""
    have: Array = field(init=False)
    """bool [K * (P + 1)]: pairs in the relaxation."""

    def __post_init__(self) -> None:
        """Lay out costs and rows; nothing is in the relaxation yet."""
        super().__post_init__()
        self.have = np.zeros(self.cost.size, dtype=bool)

    def begin(self) -> None:
        """Find first prices and a first choice; put the pairs that look good under them into the relaxation."""
        nodes, width = self.table.nodes, self.cost.shape[1]
        found, u, v = self.flow(np.arange(nodes))
        bundles = [] if self._late() else self.gainful(u, v)
        if bundles:
            taken = {node for bundle in bundles for node in self.table.items[bundle]}
            chosen = np.array([node for node in range(nodes) if node not in taken] + bundles, dtype=np.int64)
            places, per_item, v = self.flow(chosen)
            self._offer(chosen * width + places)
            u = self.split(chosen, per_item, v)
        self._offer(np.arange(nodes) * width + found)
        self.prices = self.prove(u, np.zeros(self.rows.anti_affinity))
        reduced = self.reduced(u, v, np.zeros(self.rows.anti_affinity, dtype=np.int64))
        first = [smallest(reduced, _PER_ITEM, 1), smallest(reduced, _PER_PLACE, 0), self.nowhere_pairs()]
        first += [self.best[1]] if self.best is not None else [np.arange(nodes) * width + found]
        pairs = np.unique(np.concatenate(first))
        self._first = pairs[self.cost.ravel()[pairs] < NEVER]

    def relax(self) -> None:
        """Solve the linear relaxation over all pairs; leave the prices and, rounded, a choice."""
        scale = float(max(1, self.table.cost[self.table.allowed].max(initial=1))) * self.fine
        away, most = _AWAY, self.nowhere / scale
        program, fresh = Growing(self.rows.low), self._first
        keys: Array = np.empty(0, dtype=np.int64)
        chosen: Array = np.empty(0)
        while True:
            item, place = np.divmod(fresh, self.cost.shape[1])
            price = np.where(place < self.rows.places, self.cost.ravel()[fresh] / scale, min(away, most))
            matrix = self.rows.matrix(self.members, item, place)
            if self._late():
                break
            program.add(*matrix, price)
            if (solved := program.solve(self._left())) is None:
                break
            least, chosen, dual = solved
            self.have[fresh] = True
            keys = np.concatenate([keys, fresh])
            u, v, w = self.rows.split(np.rint(dual * scale).astype(np.int64))
            found = self.prove(u, w)
            if self.prices is None or found.bound > self.prices.bound:
                self.prices = found
            if self._late() or (self._somewhere(keys, chosen) and least * scale - self.prices.bound < self.fine / 2):
                break
            fresh = self._negative(self.reduced(u, v, w), scale)
            if len(fresh) or self._cut(program, keys, chosen):
                continue
            if away >= most or self._somewhere(keys, chosen):
                break
            away *= 32
            program.reprice(np.nonzero(keys % self.cost.shape[1] == self.rows.places)[0], min(away, most))
        if len(keys):
            self._round(keys, chosen)

    def finish(self) -> None:
        """Close the gap between the best choice and the bound, if there is one, over the pairs that can matter."""
        assert self.prices is not None
        prices, reach = self.prices, 0
        self.bound = prices.bound
        reduced = self.reduced(prices.u, prices.v, prices.w).ravel()
        while not self._proved() and not self._late():
            assert self.best is not None
            gap = self.best[0] - prices.bound
            # few pairs first: mostly they hold the answer
            reach = gap if gap < 1000 * self.fine or reach else gap // 4
            pairs = np.nonzero(reduced <= reach)[0]
            if reach == gap:
                pairs = np.union1d(pairs, self.best[1])
            item, place = np.divmod(pairs, self.cost.shape[1])
            cost = (self.cost.ravel()[pairs] - self.members.sums(prices.u)[item]) * (1e4 / gap)
            matrix = self.rows.matrix(self.members, item, place)
            chosen, low, done = whole(self.rows.low, self.rows.high, *matrix, cost, self._left())
            if chosen is not None:
                self._offer(pairs[chosen])
            # whoever stays below `reach` uses none but these pairs, so their optimum speaks for all up to there
            beyond = prices.bound + reach
            here = self.best[0] if done else int(prices.u.sum()) + math.floor(max(low, -1e12) * gap / 1e4)
            self.bound = max(self.bound, min(self.best[0], here, beyond))
            if not done:
                break

    def answer(self) -> Selection | None:
        """Return the best choice in the table's own units; None when some node went nowhere."""
        if self.best is None:
            return None
        item, place = np.divmod(self.best[1], self.cost.shape[1])
        if (place == self.cost.shape[1] - 1).any():
            return None
        return outcome(self.table, item, place, -(-self.bound // self.fine))

    def _negative(self, reduced: Array, scale: float) -> Array:
        """Return pairs with negative reduced cost, a few per item and per place."""
        reduced = np.where(self.have.reshape(reduced.shape), 0, np.minimum(reduced, 0))
        few = np.unique(np.concatenate([smallest(reduced, _PER_ITEM, 1), smallest(reduced, _PER_PLACE, 0)]))
        return few[reduced.ravel()[few] < -1e-9 * scale]

    def _cut(self, program: Growing, keys: Array, chosen: Array) -> bool:
        """Add rows that the relaxation breaks; tell whether there are any."""
        item = keys // self.cost.shape[1]
        share = np.bincount(item, weights=chosen, minlength=len(self.table.items))
        partly = {int(index): float(share[index]) for index in np.nonzero((share > 1e-6) & (share < 1 - 1e-6))[0]}
        found = odd_cycles({one: much for one, much in partly.items() if one >= self.table.nodes}, self.table.items)
        found = found if len(self.rows.low) < self.rows.plain + _MOST_CUTS else []
        for items, most in found:
            row = self.rows.cut(np.array(items), most)
            program.add_row(np.nonzero(self.rows.touched(row, item))[0], most)
        return bool(found)

    def _round(self, keys: Array, chosen: Array) -> None:
        """Make a choice of the relaxation: its bundles by how far they are chosen, then the flow of the rest."""
        if ((chosen < 1e-6) | (chosen > 1 - 1e-6)).all():
            self._offer(keys[chosen > 0.5])
            return
        item = keys // self.cost.shape[1]
        share = np.bincount(item, weights=chosen, minlength=len(self.table.items))
        order = [
            int(index)
            for index in np.argsort(-share, kind="stable")
            if index >= self.table.nodes and share[index] > 0.3
        ]
        bundles = disjoint(order, self.table)
        taken = {node for bundle in bundles for node in self.table.items[bundle]}
        items = np.array([node for node in range(self.table.nodes) if node not in taken] + bundles, dtype=np.int64)
        self._offer(items * self.cost.shape[1] + self.flow(items)[0])

    def _offer(self, pairs: Array) -> None:
        """Keep a choice when it is allowed and better than the best."""
        item, place = np.divmod(pairs, self.cost.shape[1])
        if (self.cost.ravel()[pairs] >= NEVER).any() or not self.rows.kept(item, place):
            return
        cost = int(self.cost.ravel()[pairs].sum())
        if self.best is None or cost < self.best[0]:
            self.best = cost, np.sort(pairs)

    def _somewhere(self, keys: Array, chosen: Array) -> bool:
        """Return whether the relaxation leaves no node out."""
        return bool((chosen[keys % self.cost.shape[1] == self.rows.places] < 1e-9).all())

    def _proved(self) -> bool:
        """Return whether nothing a whole unit better is left."""
        if self.best is None:
            self._offer(self.nowhere_pairs())
        assert self.best is not None
        return self.best[0] - self.bound < self.fine

    def _late(self) -> bool:
        return self.until is not None and time.monotonic() > self.until

    def _left(self) -> float | None:
        """Return how many seconds a solver may take; None: as many as it wants."""
        return None if self.until is None else max(0.01, self.until - time.monotonic())
