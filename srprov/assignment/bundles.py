"""Pools -> what can be placed as one: every node alone, and every union of nodes whose pools run together.

Takes nodes, pools, costs and what must stay apart, all by name; gives Items. Pure.

A pool that runs together is on one robot, in one slot, at the discounted sum. A node is one service, or services that
`same_robot` binds. So a pool brings the whole nodes of its members along; a pool whose members are one node anyway is
together wherever that is; and two pools that share a node, but no service, may run together side by side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import msgspec

from srprov.codes import Code
from srprov.definitions.model import Pool
from srprov.errors import UsageError

_MOST = 20_000
"""Unions of nodes; more can only come from many pools on few `same_robot` groups."""


class Item(msgspec.Struct, frozen=True, kw_only=True):
    """Something that takes one slot."""

    nodes: tuple[int, ...]
    """Rising positions of its nodes."""
    alpha: float
    """The paper's alpha of it all, discounts taken off."""
    pools: tuple[Pool, ...] = ()
    """Those that run together in it."""


def items(
    nodes: Sequence[Sequence[str]],
    pools: Sequence[Pool],
    alphas: Mapping[str, float],
    anti_affinity: Sequence[Sequence[int]] = (),
) -> list[Item]:
    """Return every node alone, in order, then the bundles in the order of their nodes.

    Args:
        nodes: Services that share a robot; every service in one node at most.
        pools: Those with a service in no node are left out: it is not decided here.
        alphas: Pre-defined cost per service.
        anti_affinity: Sets of nodes that no robot may run two of.

    Raises:
        UsageError: Too many ways to combine pools with same_robot.
    """
    node_of = {service: index for index, node in enumerate(nodes) for service in node}
    usable = [pool for pool in pools if len(pool.services) > 1 and node_of.keys() >= set(pool.services)]
    groups_of: dict[int, int] = {}  # node -> a bit for each group that has it
    for bit, group in enumerate(anti_affinity if usable else ()):
        groups_of.update((node, groups_of.get(node, 0) | 1 << bit) for node in group)
    best: dict[tuple[int, ...], tuple[float, tuple[Pool, ...]]] = {(index,): (0.0, ()) for index in range(len(nodes))}
    for chosen in _together(usable, node_of):
        union = tuple(sorted({node_of[service] for pool in chosen for service in pool.services}))
        if _apart(union, groups_of):
            continue
        saved = sum(saving(pool, alphas) for pool in chosen)
        if union not in best or saved > best[union][0]:
            best[union] = saved, chosen
    found = []
    for union, (saved, chosen) in sorted(best.items(), key=lambda entry: (len(entry[0]) > 1, entry[0])):
        alpha = sum(alphas[service] for index in union for service in nodes[index])
        found.append(Item(nodes=union, alpha=max(0.0, alpha - saved), pools=chosen))
    return found


def _apart(union: Sequence[int], groups_of: Mapping[int, int]) -> bool:
    """Return whether two of some nodes are in one group."""
    seen = 0
    for node in union:
        if seen & groups_of.get(node, 0):
            return True
        seen |= groups_of.get(node, 0)
    return False


def saving(pool: Pool, alphas: Mapping[str, float]) -> float:
    """Return the alpha that a pool takes off when it runs together."""
    return (1.0 - pool.discount) * sum(alphas[service] for service in pool.services)


def _together(pools: Sequence[Pool], node_of: Mapping[str, int]) -> Iterator[tuple[Pool, ...]]:
    """Return every set of pools that share no service and hang together by their nodes, each once."""
    touches = [frozenset(node_of[service] for service in pool.services) for pool in pools]
    seen = {frozenset({index}) for index in range(len(pools))}
    queue = sorted(seen, key=sorted)
    for chosen in queue:
        yield tuple(pools[index] for index in sorted(chosen))
        nodes = frozenset().union(*(touches[index] for index in chosen))
        services = {service for index in chosen for service in pools[index].services}
        for index, pool in enumerate(pools):
            more = chosen | {index}
            if touches[index] & nodes and services.isdisjoint(pool.services) and more not in seen:
                seen.add(more)
                queue.append(more)
                if len(seen) > _MOST:
                    raise UsageError(
                        "too many ways to combine pools with same_robot", hint="use fewer pools", code=Code.TOO_HARD
                    )
