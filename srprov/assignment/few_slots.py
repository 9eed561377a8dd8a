"""How many slots of each robot a search looks at: all of them, or in a large plain problem the first few that matter.

A slot costs at least what the slots before it on its robot cost, and may be used by the same services. So where the
best placement over the first slots leaves one of them free on each robot, no further slot can make it better: by the
prices of linear programming a free slot is worth nothing, and one that costs more is not either. Where a robot is full,
more of its slots are looked at. Pure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from srprov.assignment.model import Problem

PAIRS = 500_000
"""Of nodes and slots, up to which all slots are looked at; a search takes some 130 bytes for each."""


def first(problem: Problem) -> Mapping[str, int]:
    """Return how many slots of each robot to look at first."""
    nodes, total = len(problem.nodes), sum(problem.slots.values())
    plain = not problem.pools and not problem.kept_apart and problem.fairness.weight <= 0
    if not plain or nodes * total <= PAIRS:
        return problem.slots
    most = max(2, nodes * 5 // (4 * len(problem.slots)) + 2)
    return {robot: min(count, most) for robot, count in problem.slots.items()}


def more(problem: Problem, slots: Mapping[str, int], found: Iterable[Iterable[str]]) -> Mapping[str, int] | None:
    """Return how many slots to look at next, or None where the answer is that of all slots.

    Args:
        problem: With all slots.
        slots: Those that were looked at.
        found: For each placement that must be the best one: the robot of every node.
    """
    used = [Counter(robots) for robots in found]
    full = [
        robot for robot, count in slots.items()
        if count < problem.slots[robot] and any(one[robot] >= count for one in used)
    ]  # fmt: skip
    if not full:
        return None
    return {**slots, **{robot: min(problem.slots[robot], 2 * slots[robot]) for robot in full}}
