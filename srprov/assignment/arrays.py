"""A Problem as arrays: items, places, costs, moves, fairness; and as a Table with one objective.

Takes a Problem; gives arrays in whole numbers. Pure. A cost is alpha times what one alpha costs in that slot of that
robot, so a whole matrix is one product.

    unit        round(cost * SCALE), SCALE = 1 000 000
    free        unit * (1 + most possible moves) + moves        lower cost first, then fewer services that move
    sticky      moves * (1 + largest possible sum) + unit       the other way round

Both orders are lexicographic and exact. Source: docs/assignment.md.
"""

from __future__ import annotations

import msgspec
import numpy as np

from srprov.assignment.apart import at_once, check_size, maximal
from srprov.assignment.bundles import Item, items
from srprov.assignment.cost import terms
from srprov.assignment.model import SCALE, Problem, ServiceGroup
from srprov.assignment.table import Array, ProblemTable


class Arrays(msgspec.Struct, frozen=True, kw_only=True):
    """K items on P places (slots of reachable robots); the first N items are the problem's nodes."""

    items: tuple[Item, ...]
    names: tuple[ServiceGroup, ...]
    """K times the services of the item, in name order."""
    places: tuple[tuple[str, int], ...]
    """P times (robot, slot)."""
    allowed: Array
    """bool [K, P]"""
    cost: Array
    """int64 [K, P], in millionths."""
    wanted: Array
    """int64 [K, P]: what is minimised beside moves; the cost, or with fairness a mixture."""
    moves: Array
    """int64 [K, P]: services of the item that run on another robot now."""
    robots: Array
    """int64 [P]: position of the robot in name order."""
    anti_affinity: tuple[tuple[int, ...], ...]
    """Sets of nodes."""

    @property
    def nodes(self) -> int:
        """Return N."""
        return sum(len(item.nodes) == 1 for item in self.items)

    def table(self, cost: Array, allowed: Array | None = None) -> ProblemTable:
        """Return the table with an objective, int64 [K, P]."""
        return ProblemTable(
            items=tuple(item.nodes for item in self.items),
            nodes=self.nodes,
            cost=cost,
            allowed=self.allowed if allowed is None else allowed,
            robots=self.robots,
            anti_affinity=self.anti_affinity,
        )

    def free(self, wanted: Array) -> Array:
        """Return the objective of lower cost first, then fewer moves."""
        return wanted * (1 + int(self.moves.max(axis=1, initial=0).sum())) + self.moves

    def sticky(self, wanted: Array) -> Array:
        """Return the objective of fewer moves first, then lower cost."""
        return self.moves * (1 + self.nodes * int(wanted[self.allowed].max(initial=0))) + wanted

    def fewest(self) -> Array:
        """Return bool [K, P]: allowed pairs in which no service moves that could stay, were it alone in the world."""
        moves, nodes = np.where(self.allowed, self.moves, 1 << 30), self.nodes
        least = moves[:nodes].min(axis=1, initial=1 << 30)
        together = np.array([sum(int(least[node]) for node in item.nodes) for item in self.items], dtype=np.int64)
        fewest: Array = self.allowed & (self.moves <= together[:, None])
        return fewest


def arrays(problem: Problem) -> Arrays:
    """Lay out a problem.

    Raises:
        UsageError: Too many ways to combine pools with same_robot, or too much to keep apart.
    """
    node_of = {service: index for index, node in enumerate(problem.nodes) for service in node}
    groups = [tuple(sorted({node_of[name] for name in group if name in node_of})) for group in problem.kept_apart]
    anti_affinity = tuple(maximal(group for group in groups if len(group) > 1))
    found = tuple(items(problem.nodes, problem.pools, problem.alphas, anti_affinity))
    names = tuple(tuple(sorted(name for node in item.nodes for name in problem.nodes[node])) for item in found)
    # a slot costs at least what those before it on its robot cost, and no robot can use more than so many
    most = at_once(len(problem.nodes), anti_affinity)
    places = tuple((robot, slot) for robot in problem.slots for slot in range(min(most, problem.slots[robot])))
    crowded = sum(slot == 1 for _, slot in places)
    anti_affinity = anti_affinity if crowded else ()
    if anti_affinity or len(found) > len(problem.nodes):
        check_size(anti_affinity, crowded, len(found), len(places))
    at = {robot: index for index, robot in enumerate(problem.loads)}
    robots = np.array([at[robot] for robot, _ in places], dtype=np.int64)
    unit = np.array([terms(1.0, problem.loads[robot][slot], problem.weights).total for robot, slot in places])
    alpha = np.array([item.alpha for item in found])
    price = alpha.reshape(-1, 1) * unit.reshape(1, -1)
    return Arrays(
        items=found,
        names=names,
        places=places,
        allowed=_allowed(problem, names, robots),
        cost=np.rint(price * SCALE).astype(np.int64),
        wanted=np.rint(_wanted(problem, names, price, robots) * SCALE).astype(np.int64),
        moves=_moves(problem, names, at, robots),
        robots=robots,
        anti_affinity=anti_affinity,
    )


def _allowed(problem: Problem, names: tuple[ServiceGroup, ...], robots: Array) -> Array:
    """Return bool [K, P]: the robot lacks nothing for any service of the item."""
    width = (len(problem.loads) + 7) // 8
    rows = b"".join(problem.able(item).to_bytes(width, "little") for item in names)
    packed = np.frombuffer(rows, dtype=np.uint8).reshape(len(names), width)
    able = np.unpackbits(packed, axis=1, count=len(problem.loads), bitorder="little").astype(bool)
    allowed: Array = able[:, robots]
    return allowed


def _moves(problem: Problem, names: tuple[ServiceGroup, ...], at: dict[str, int], robots: Array) -> Array:
    """Return int64 [K, P]: services of the item that run on another robot now."""
    moves: Array = np.zeros((len(names), len(problem.loads)), dtype=np.int64)
    for index, item in enumerate(names) if problem.previous else ():
        for name in item:
            if name in problem.previous:
                moves[index] += 1
                if problem.previous[name] in at:
                    moves[index, at[problem.previous[name]]] -= 1
    spread: Array = moves[:, robots]
    return spread


def _wanted(problem: Problem, names: tuple[ServiceGroup, ...], price: Array, robots: Array) -> Array:
    """Return float [K, P]: the costs, for items not placed yet mixed with what they add to the sum of squares.

    With d what a robot has carried beyond the one that carried least, c the cost, and m what a robot has carried on
    average plus the mean cost of a node: (1 - f) * c + f * ((d + c)^2 - d^2) / m. Against m, because evenness is of
    shares: what one run adds must not count for more, the longer the history gets.
    """
    fairness = problem.fairness
    fresh = np.array([not problem.previous.keys() & set(item) for item in names], dtype=bool)
    if fairness.weight <= 0 or not fresh.any() or not price.size:
        return price
    carried = np.array([fairness.carried.get(robot, 0.0) for robot in problem.loads])
    beyond = (carried - carried.min())[robots]
    mean = float(carried.mean() + price[: len(problem.nodes)].mean()) or 1.0
    mixed = (1 - fairness.weight) * price + fairness.weight * (2 * beyond + price) * price / mean
    chosen: Array = np.where(fresh[:, None], mixed, price)
    return chosen
