"""Random instances, the same for every solver: costs as the paper forms them, or plain random numbers."""

from __future__ import annotations

import numpy as np

from srprov.assignment.table import ProblemTable

ELIGIBLE = 0.7
DISCOUNT = 0.8


def table(kind: str, robots: int, services: int, pools: int, seed: int) -> ProblemTable:
    """Return a Table in millionths.

    Args:
        kind: `loads`: alpha times what random loads cost by the paper's function; `uniform`: every cost 0..100.
        robots: Each with one slot.
        services: Each may run on 70 % of the robots.
        pools: Of 2-4 services, discount 0.8; they may overlap.
        seed: Of the random numbers.
    """
    random = np.random.default_rng(seed)
    able = random.random((services, robots)) < ELIGIBLE
    if kind == "uniform":
        cost = random.random((services, robots)) * 100
    else:
        beta = random.random((4, robots))
        unit = 0.25 * (beta[0] ** 4 + beta[1] ** 4 + 0.3 * beta[2] + (1 - beta[3]) ** 4)
        cost = random.uniform(0, 100, services)[:, None] * unit[None, :]
    cost = np.rint(cost * 1e6).astype(np.int64)
    groups = [
        tuple(sorted(random.choice(services, random.integers(2, 5), replace=False).tolist())) for _ in range(pools)
    ]
    together = [np.rint(DISCOUNT * cost[list(group)].sum(axis=0)).astype(np.int64)[None] for group in groups]
    return ProblemTable(
        items=(*((node,) for node in range(services)), *groups),
        nodes=services,
        cost=np.vstack([cost, *together]),
        allowed=np.vstack([able, *(able[list(group)].all(axis=0)[None] for group in groups)]),
        robots=np.arange(robots),
    )
