"""The rows of the model with pools and relations, and small helpers of the search over its pairs.

Takes a Table and pairs (item, place) as arrays; gives index arrays. Pure.
"""

from __future__ import annotations

import numpy as np

from srprov.assignment.table import Array, Members, ProblemTable


class ConstraintRows:
    """The rows of the model: one per node, per place, per anti-affinity set and robot with several places, per cut."""

    def __init__(self, table: ProblemTable) -> None:
        """Lay them out."""
        self.nodes, self.places = table.nodes, table.cost.shape[1]
        shared, counts = np.unique(table.robots, return_counts=True)
        crowded = {int(robot): index for index, robot in enumerate(shared[counts > 1])}
        self._robot: Array = np.array([crowded.get(int(robot), -1) for robot in table.robots], dtype=np.int64)
        self._width = len(crowded)
        groups = table.anti_affinity if crowded else ()
        of_node: dict[int, list[int]] = {}
        for index, group in enumerate(groups):
            for node in group:
                of_node.setdefault(node, []).append(index)
        # no item holds two nodes of a group
        of_item = [[index for node in item for index in of_node.get(node, ())] for item in table.items]
        self._groups = Members(of_item, len(groups))
        inside: list[list[int]] = [[] for _ in groups]
        for item, some in enumerate(of_item):
            for index in some:
                inside[index].append(item)
        self._inside: list[Array] = [np.array(items, dtype=np.int64) for items in inside]
        self.anti_affinity = len(groups) * self._width
        free = np.full(self.places + self.anti_affinity, -np.inf)
        self.low: Array = np.concatenate([np.ones(self.nodes), free])
        self.high: Array = np.ones(len(self.low))
        self.plain = len(self.low)
        """Rows without cuts."""
        self._items = len(table.items)
        self._cuts: list[Array] = []

    def cut(self, items: Array, most: int) -> int:
        """Add a row: at most so many of the items; give its number."""
        inside: Array = np.zeros(self._items, dtype=bool)
        inside[list(items)] = True
        self._cuts.append(inside)
        self.low, self.high = np.append(self.low, -np.inf), np.append(self.high, float(most))
        return len(self.low) - 1

    def touched(self, row: int, item: Array) -> Array:
        """Return bool: which pairs, by their items, are in a cut."""
        touched: Array = self._cuts[row - self.nodes - self.places - self.anti_affinity][item]
        return touched

    def matrix(self, members: Members, item: Array, place: Array) -> tuple[Array, Array]:
        """Return (row, column) of every 1 for the pairs; nowhere (the place after the last) has no row."""
        row, column = members.rows(item)
        somewhere = np.nonzero(place < self.places)[0]
        rows, columns = [row, self.nodes + place[somewhere]], [column, somewhere]
        crowded = somewhere[self._robot[place[somewhere]] >= 0]
        group, position = self._groups.rows(item[crowded])
        rows.append(self.nodes + self.places + group * self._width + self._robot[place[crowded]][position])
        columns.append(crowded[position])
        for index, inside in enumerate(self._cuts):
            touched = np.nonzero(inside[item])[0]
            rows.append(np.full(len(touched), self.nodes + self.places + self.anti_affinity + index))
            columns.append(touched)
        return np.concatenate(rows), np.concatenate(columns)

    def split(self, dual: Array) -> tuple[Array, Array, Array]:
        """Return u [N], v [P] and w from the dual values of all rows."""
        ends = self.nodes, self.nodes + self.places
        return dual[: ends[0]], dual[ends[0] : ends[1]], dual[ends[1] :]

    def subtract(self, reduced: Array, w: Array) -> None:
        """Take anti-affinity prices and cuts off reduced costs [K, P + 1], in place; `w` may be of fewer cuts."""
        crowded = np.nonzero(self._robot >= 0)[0]
        for index, inside in enumerate(self._inside):
            prices = w[index * self._width : (index + 1) * self._width]
            if prices.any():
                reduced[np.ix_(inside, crowded)] -= prices[self._robot[crowded]]
        for inside, price in zip(self._cuts, w[self.anti_affinity :].tolist(), strict=False):
            reduced[inside] -= price

    def worth(self, w: Array) -> int:
        """Return what prices of `anti_affinity` and cuts add to the bound."""
        return int((w * self.high[self.nodes + self.places :][: len(w)].astype(np.int64)).sum())

    def kept(self, item: Array, place: Array) -> bool:
        """Return whether a choice keeps `anti_affinity`."""
        robot: Array = np.append(self._robot, -1)[place]
        crowded = robot >= 0
        group, position = self._groups.rows(item[crowded])
        used = group * self._width + robot[crowded][position]
        return len(np.unique(used)) == len(used)


def disjoint(order: list[int], table: ProblemTable) -> list[int]:
    """Return the items of a list that have no node in common with an earlier one, rising."""
    taken: set[int] = set()
    kept = []
    for item in order:
        if taken.isdisjoint(table.items[item]):
            kept.append(item)
            taken.update(table.items[item])
    return sorted(kept)


def smallest(values: Array, count: int, axis: int) -> Array:
    """Return the flat positions of the `count` smallest values of every row (axis 1) or column (axis 0) of a matrix."""
    rows, columns = values.shape
    count = min(count, values.shape[axis])
    if count == 0 or values.size == 0:
        return np.empty(0, dtype=np.int64)
    if axis == 1:
        picked = np.argpartition(values, count - 1, axis=1)[:, :count]
        return (np.arange(rows)[:, None] * columns + picked).ravel()
    picked = np.argpartition(values, count - 1, axis=0)[:count]
    return (picked * columns + np.arange(columns)).ravel()
