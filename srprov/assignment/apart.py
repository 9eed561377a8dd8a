"""Groups of which a robot takes one member at most: only those that say something, and how many of them can be.

Takes sets of whole numbers; gives those that lie in no other, and how many members a robot can take at once. Pure.

What two sets forbid a set with all their members forbids: one that lies in another changes no answer, but every row of
the model costs time and memory. Hundreds of services with a thousand ports each, every range a little further than the
one before, have thousands of such sets.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence

from srprov.codes import Code
from srprov.errors import UsageError

MOST_MEMBERS = 100_000
"""Of all groups together; each is in several rows of the model."""
MOST_ON_ROBOTS = 4_000_000
"""Members of all groups, times the robots that have room for two of one."""
MOST_PAIRS = 10_000_000
"""Of what is placed and where it can be, where more than a flow must be searched: some 130 bytes each."""

Group = tuple[int, ...]


def maximal(groups: Iterable[Group]) -> list[Group]:
    """Return the groups that lie in no other, each once, in the order given.

    Args:
        groups: Each of rising numbers.

    Raises:
        UsageError: They have more members than can be searched with.
    """
    given = dict.fromkeys(groups)
    within: dict[int, int] = {}  # member -> a bit for each group that is kept and has it
    kept: set[Group] = set()
    members = 0
    for group in sorted(given, key=len, reverse=True):  # whatever holds a group comes before it
        holding = -1
        for member in group:
            holding &= within.get(member, 0)
            if not holding:
                break
        if holding:
            continue
        if (members := members + len(group)) > MOST_MEMBERS:
            raise too_hard()
        for member in group:
            within[member] = within.get(member, 0) | 1 << len(kept)
        kept.add(group)
    return [group for group in given if group in kept]


def at_once(nodes: int, groups: Sequence[Group]) -> int:
    """Return how many of the nodes 0..N-1 a robot can take at most: one of each group that is needed to hold all.

    Args:
        nodes: N.
        groups: Those of which it takes one.
    """
    groups_of: dict[int, list[int]] = {}
    for index, group in enumerate(groups):
        for node in group:
            groups_of.setdefault(node, []).append(index)
    left, counts, needed = set(range(nodes)), [len(group) for group in groups], 0
    queue = [(-count, index) for index, count in enumerate(counts)]
    heapq.heapify(queue)
    while queue:
        count, index = heapq.heappop(queue)
        if -count > counts[index] > 1:
            heapq.heappush(queue, (-counts[index], index))
        elif counts[index] > 1:  # it holds most of what is left
            needed += 1
            for node in left.intersection(groups[index]):
                left.remove(node)
                for other in groups_of[node]:
                    counts[other] -= 1
    return needed + len(left)


def check_size(groups: Sequence[Group], robots: int, items: int, places: int) -> None:
    """Refuse what would take too much memory before it takes too much time.

    Raises:
        UsageError: It would.
    """
    if sum(map(len, groups)) * robots > MOST_ON_ROBOTS:
        raise too_hard()
    if items * places > MOST_PAIRS:
        message = f"{items} things to place on {places} slots are too many to search with different_robot or pools"
        hint = "lower slots_per_robot (or srprov_slots in the inventory), or make experiments of parts of it"
        raise UsageError(message, hint=hint, code=Code.TOO_HARD)


def too_hard() -> UsageError:
    """Return the error for groups that are too many."""
    message = "too many services must be on different robots, for ports that they have in common or by different_robot"
    hint = "publish fewer ports, lower replicas, or make experiments of parts of it"
    return UsageError(message, hint=hint, code=Code.TOO_HARD)
