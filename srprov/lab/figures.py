"""Simulated figures of a robot, as the kernel's files show them. Pure: values in, texts out."""

from __future__ import annotations

import msgspec


class Amount(msgspec.Struct, frozen=True):
    """So much there is and so much is in use, both in bytes."""

    total: int
    used: int = 0


def loadavg(load: float) -> str:
    """/proc/loadavg of a robot with this load for the last 15 minutes."""
    return f"{load:.2f} {load:.2f} {load:.2f} 1/100 1000\n"


def meminfo(real: str, memory: Amount | None, swap: Amount | None) -> str:
    """/proc/meminfo with the figures put in; every other line stays as the machine's is.

    Buffers and caches become 0, so that every tool's way to compute "used" gives the same.
    """
    figures: dict[str, int] = {}
    if memory is not None:
        free = memory.total - memory.used
        figures |= {"MemTotal": memory.total, "MemFree": free, "MemAvailable": free}
        figures |= dict.fromkeys(("Buffers", "Cached", "SReclaimable", "Shmem"), 0)
    if swap is not None:
        figures |= {"SwapTotal": swap.total, "SwapFree": swap.total - swap.used, "SwapCached": 0}
    lines = []
    for line in real.splitlines():
        name = line.partition(":")[0]
        known = figures.get(name)
        lines.append(line if known is None else f"{name + ':':<16}{known // 1024:>8} kB")
    return "\n".join(lines) + "\n"
