"""How many worker processes there are, and which of them has a robot."""

from __future__ import annotations

import hashlib
import os

MANY_ROBOTS = 200
"""From so many on, `auto` takes a worker for each processor: with fewer, what they take to start is not made up for."""


CROWDED_S = 0.05
"""How long a thread may compute before others are let in, in a process with so many connections. Each has a thread, and
those that wait wake as often: with Python's 5 ms a fifth of the processor's time went into that."""


def wanted_workers(text: str, robots: int) -> int:
    """Return how many processes to use for so many robots: a number as it is, `auto` by the processors."""
    if text != "auto":
        return max(1, min(int(text), robots))
    if robots < MANY_ROBOTS:
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def shard(name: str, count: int) -> int:
    """Return which of so many workers has a robot; the same one whoever asks, and whatever other robots there are."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big") % count
