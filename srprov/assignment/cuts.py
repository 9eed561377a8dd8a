"""Odd cycles of bundles: inequalities that every placement keeps and that the linear relaxation may break.

Takes how far the relaxation chooses each bundle; gives (items, most) such that no placement holds more than `most` of
the items. Pure.

Two bundles with a node in common exclude each other. In a cycle of an odd number L of bundles, each excluding the next,
at most (L - 1) / 2 can be; the relaxation likes to choose a half of each. Source: M. Groetschel, L. Lovasz and
A. Schrijver, *Geometric Algorithms and Combinatorial Optimization*, section 9.1: shortest paths in the doubled graph.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

Cut = tuple[tuple[int, ...], int]
"""Items, and how many of them there can be at most."""
_LEAST = 0.01
"""Bundles chosen less than this far, and inequalities broken by less, are left alone."""


def odd_cycles(shares: Mapping[int, float], items: Sequence[Sequence[int]]) -> list[Cut]:
    """Return inequalities that these shares break, each once.

    Args:
        shares: Bundle -> how far it is chosen, 0..1.
        items: The nodes of every item.
    """
    near = _exclusions([bundle for bundle, share in sorted(shares.items()) if share > _LEAST], items)
    found: set[Cut] = set()
    for start in near:
        cycle = _shortest(start, near, shares)
        if len(cycle) == 3:
            clique = _extended(cycle, items)
            found.add((clique, 1))
        elif cycle:
            found.add((tuple(sorted(cycle)), (len(cycle) - 1) // 2))
    return sorted(found)


def _exclusions(bundles: Sequence[int], items: Sequence[Sequence[int]]) -> dict[int, list[int]]:
    """Return bundle -> those that have a node in common with it."""
    nodes = {bundle: set(items[bundle]) for bundle in bundles}
    return {one: [two for two in bundles if two != one and nodes[one] & nodes[two]] for one in bundles}


def _shortest(start: int, near: Mapping[int, Sequence[int]], shares: Mapping[int, float]) -> list[int]:
    """Return the odd cycle through a bundle that is broken most, or nothing."""
    best: dict[tuple[int, int], float] = {(start, 0): 0.0}
    came: dict[tuple[int, int], tuple[int, int]] = {}
    queue = [(0.0, start, 0)]
    while queue:
        length, bundle, side = heapq.heappop(queue)
        if length > best[bundle, side] or length >= 1 - 2 * _LEAST:
            continue
        if (bundle, side) == (start, 1):
            break
        for other in near[bundle]:
            step = length + max(0.0, 1 - shares[bundle] - shares[other])
            if step < best.get((other, 1 - side), 2.0):
                best[other, 1 - side] = step
                came[other, 1 - side] = bundle, side
                heapq.heappush(queue, (step, other, 1 - side))
    if best.get((start, 1), 2.0) >= 1 - 2 * _LEAST:
        return []
    cycle, at = [], (start, 1)
    while at != (start, 0):
        at = came[at]
        cycle.append(at[0])
    return cycle if len(set(cycle)) == len(cycle) else []


def _extended(cycle: Sequence[int], items: Sequence[Sequence[int]]) -> tuple[int, ...]:
    """Return three bundles that exclude each other with all others that exclude every one of them."""
    clique, nodes = list(cycle), [set(items[item]) for item in cycle]
    for item in range(len(items)):
        if len(items[item]) > 1 and item not in clique and all(own.intersection(items[item]) for own in nodes):
            clique.append(item)
            nodes.append(set(items[item]))
    return tuple(sorted(clique))
