"""Cut a plan into batches that run on one robot without looking at any other.

A new batch begins before a step that needs another robot, and after a step that another robot needs. So a robot is
read once, does several steps and is verified once, and no robot waits for more than it needs. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from srprov.planning.plan import Step


class Batch(msgspec.Struct, frozen=True, kw_only=True):
    """Consecutive steps of one robot."""

    index: int
    host: str
    steps: tuple[Step, ...]
    needs: frozenset[int]
    """Indexes of batches that must have ended first; the robot's previous one is among them."""


class Order:
    """Which batches may begin: each as soon as all that it needs have ended."""

    def __init__(self, batches: Sequence[Batch]) -> None:
        """Take all of them."""
        self._missing = {batch.index: len(batch.needs) for batch in batches}
        self.first = [batch.index for batch in batches if not batch.needs]
        self._followers: dict[int, list[int]] = {}
        for batch in batches:
            for needed in batch.needs:
                self._followers.setdefault(needed, []).append(batch.index)

    def ended(self, index: int) -> list[int]:
        """Return those that were waiting for this one alone, which has ended."""
        followers = self._followers.get(index, ())
        for one in followers:
            self._missing[one] -= 1
        return [one for one in followers if self._missing[one] == 0]


def cut(steps: Sequence[Step]) -> tuple[Batch, ...]:
    """Return the batches of a plan's steps, which stand in an order that respects their needs."""
    by_number = {step.number: step for step in steps}
    needed_elsewhere = {n for step in steps for n in step.needs if by_number[n].host != step.host}
    groups: list[list[Step]] = []
    current: dict[str, int] = {}
    for step in steps:
        foreign = step.waits or any(by_number[n].host != step.host for n in step.needs)
        last = current.get(step.host)
        if last is None or foreign or groups[last][-1].number in needed_elsewhere:
            current[step.host] = len(groups)
            groups.append([step])
        else:
            groups[last].append(step)
    return _linked(groups)


def _linked(groups: Sequence[Sequence[Step]]) -> tuple[Batch, ...]:
    home = {step.number: index for index, group in enumerate(groups) for step in group}
    previous: dict[str, int] = {}
    linked = []
    for index, group in enumerate(groups):
        host = group[0].host
        needs = {home[number] for step in group for number in step.needs} - {index}
        if host in previous:
            needs.add(previous[host])
        previous[host] = index
        linked.append(Batch(index=index, host=host, steps=tuple(group), needs=frozenset(needs)))
    return tuple(linked)
