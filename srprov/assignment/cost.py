"""What a service costs on a robot: the paper's cost function.

Takes a service's alpha, the EDF's weights and what is known of the robot; gives the cost by term. Pure: no I/O, no
clock.

Source: *SwarmRob: A Toolkit for Reproducibility and Sharing of Experimental Artifacts in Robotics Research*, the
section on resource allocation: `a = e*d_e + n*d_n + z*d_z + t*d_t` with `e = alpha*beta^4` (CPU), `n = alpha*beta^4`
(memory, the paper's VRAM), `z = alpha*beta` (swap), `t = alpha*(1-beta)^4` (bandwidth). Jain's index: Jain, Chiu and
Hawe, DEC-TR-301, 1984.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
from msgspec.structs import replace

from srprov.definitions.model import Weights
from srprov.facts.model import HostFacts


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """The paper's betas of one robot, each in 0..1; `bandwidth` is what is still free, the others are what is used."""

    cpu: float
    memory: float
    swap: float
    bandwidth: float
    notes: tuple[str, ...] = ()
    """What had to be assumed, in words."""


class CostTerms(msgspec.Struct, frozen=True, kw_only=True):
    """The weighted terms of one cost; no unit, each in 0..100 times its weight."""

    cpu: float
    memory: float
    swap: float
    bandwidth: float

    @property
    def total(self) -> float:
        """The paper's `a`: the sum of the terms."""
        return self.cpu + self.memory + self.swap + self.bandwidth


def load(facts: HostFacts, reference_mbit: float) -> Load:
    """Return the relative loads of a robot.

    Args:
        facts: The robot. `speed_mbit` is the link's, or the inventory's `srprov_bandwidth_mbit`, which wins.
        reference_mbit: The Mbit/s that count as all the bandwidth one could want.

    What is not known counts as idle, because a robot should not lose for what its driver does not tell: a link of
    unknown speed counts as the reference, and `notes` says so.
    """
    notes: list[str] = []
    bandwidth = 1.0
    if facts.speed_mbit > 0:
        bandwidth = _share(facts.speed_mbit - facts.traffic_mbit, reference_mbit)
    else:
        notes.append("link speed unknown: counted as the reference, no cost for bandwidth (set srprov_bandwidth_mbit)")
    return Load(
        cpu=_share(facts.load1, facts.cpus),
        memory=_share(facts.memory_total - facts.memory_available, facts.memory_total),
        swap=_share(facts.swap_total - facts.swap_free, facts.swap_total),
        bandwidth=bandwidth,
        notes=tuple(notes),
    )


def at_slot(idle: Load, slot: int, slots: int) -> Load:
    """Return the load a service meets in a slot (from 0) of `slots`: the CPU beta raised by slot / slots, at most 1.

    So slot 0 is the paper's cost, and several services on one robot stay an assignment problem: the cost of a slot does
    not depend on who has the others.
    """
    return replace(idle, cpu=min(1.0, idle.cpu + slot / slots)) if slot else idle


def terms(alpha: float, beta: Load, weights: Weights) -> CostTerms:
    """Return the weighted terms for a service's pre-defined cost `alpha` (0..100) under the loads `beta`."""
    return CostTerms(
        cpu=alpha * beta.cpu**4 * weights.cpu,
        memory=alpha * beta.memory**4 * weights.memory,
        swap=alpha * beta.swap * weights.swap,
        bandwidth=alpha * (1.0 - beta.bandwidth) ** 4 * weights.bandwidth,
    )


def jain(costs: Iterable[float]) -> float:
    """Return Jain's index `(sum x)^2 / (n * sum x^2)` of costs per robot, in 1/n..1; 1 when all are 0."""
    values = tuple(costs)
    squares = sum(value * value for value in values)
    return sum(values) ** 2 / (len(values) * squares) if squares > 0 else 1.0


def _share(part: float, whole: float) -> float:
    """Return `part / whole` within 0..1; 0 for a whole of nothing, as with a robot that has no swap."""
    return min(1.0, max(0.0, part / whole)) if whole > 0 else 0.0
