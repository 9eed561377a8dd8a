"""Stretches of time as sorted pairs that do not touch: united, taken from each other, summed. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

Spans: TypeAlias = "list[tuple[float, float]]"
"""Begin and end in seconds, in order, none touching the next."""


def united(spans: Iterable[tuple[float, float]]) -> Spans:
    """Return what any of them covers; one that ends before it begins covers nothing."""
    found: Spans = []
    for begin, end in sorted(spans):
        if end <= begin:
            continue
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return found


def without(spans: Spans, taken: Spans) -> Spans:
    """Return what is left of the first when the second is taken away."""
    found: Spans = []
    at = 0
    for first, end in spans:
        begin = first
        while at < len(taken) and taken[at][1] <= begin:
            at += 1
        now = at
        while now < len(taken) and taken[now][0] < end:
            if taken[now][0] > begin:
                found.append((begin, taken[now][0]))
            begin = max(begin, taken[now][1])
            now += 1
        if begin < end:
            found.append((begin, end))
    return found


def total(spans: Spans) -> float:
    """Return how long they are together."""
    return sum(end - begin for begin, end in spans)
