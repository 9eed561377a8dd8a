"""Which images of srprov's nobody needs any more, and the plan that takes them away.

Takes what robots have and what runs of this machine named; gives a plan, which is done as any other: with locks, audit
lines and a record. Touches nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.controller.plan import Planned
from srprov.controller.stored_images import RobotStore, StoredImage
from srprov.execution import Outcome, RunResult
from srprov.facts.model import Snapshot
from srprov.planning.plan import Plan, Step
from srprov.planning.steps import removal_step
from srprov.resource import Observed

INSTANCE = ".images"
"""What locks, audit lines and records call it; no instance has that name."""


class Pruning(msgspec.Struct, frozen=True, kw_only=True):
    """What goes from each robot."""

    gone: Mapping[str, tuple[StoredImage, ...]]
    """Robot -> images; robots without any are not in it."""
    freed: Mapping[str, int]
    """Robot -> bytes of layers that nothing needs then, as far as its engine tells sizes."""
    stay: int
    """Images of srprov's that stay, on all robots."""
    planned: Planned


def choose(
    there: Mapping[str, RobotStore], unreachable: Mapping[str, str], named: Mapping[str, Collection[str]],
    *, only: Collection[str] | None = None, before: float | None = None,
) -> Pruning:  # fmt: skip
    """Say what goes: what no container was made from, no run named last, and nobody else gave a name.

    Args:
        there: Robot -> what it has of srprov's, with what images of others share.
        unreachable: Robots that were not asked.
        named: Image -> the instances whose last run named it.
        only: Repositories (`srprov/NAME`) of one experiment; None: any image, also without a name.
        before: Only what was built before this moment, in seconds since 1970.
    """
    gone: dict[str, tuple[StoredImage, ...]] = {}
    for robot, store in sorted(there.items()):
        # the newest first: one may be built on another
        chosen = [one for one in store.images if _may_go(one, named, only, before)]
        if chosen:
            ordered = sorted(chosen, key=lambda one: (-one.created, not one.tags, one.names))
            gone[robot] = tuple(_with_own_steps(ordered))
    steps = [step for robot, images in gone.items() for one in images for step in _steps(robot, one)]
    plan = Plan(
        instance=INSTANCE,
        source="",
        steps=tuple(replace(step, number=number) for number, step in enumerate(steps, 1)),
        unreachable=unreachable,
    )
    return Pruning(
        gone=gone,
        freed={robot: there[robot].freed(images) for robot, images in gone.items()},
        stay=sum(len(store.images) for store in there.values()) - sum(map(len, gone.values())),
        planned=Planned(plan=plan, snapshot=Snapshot(facts={}, observed={}, unreachable=unreachable)),
    )


def freed_by(result: RunResult, made: Pruning, there: Mapping[str, RobotStore]) -> int:
    """Return the bytes of layers that nothing needs after a run that may not have done all."""
    fine = (Outcome.CHANGED, Outcome.UNCHANGED)
    left = {(one.step.host, one.step.name) for one in result.results if one.outcome not in fine}
    gone = {
        robot: [one for one in images if left.isdisjoint((robot, name) for name in one.names)]
        for robot, images in made.gone.items()
    }
    return sum(there[robot].freed(images) for robot, images in gone.items())


def _with_own_steps(images: Sequence[StoredImage]) -> list[StoredImage]:
    """Leave each step of a build to the last of those that stand on it."""
    seen: set[str] = set()
    found = []
    for one in reversed(images):
        found.append(replace(one, steps=tuple(step for step in one.steps if step not in seen)))
        seen.update(one.steps)
    return found[::-1]


def _may_go(
    one: StoredImage, named: Mapping[str, Collection[str]], only: Collection[str] | None, before: float | None
) -> bool:
    if one.containers or one.others or any(tag in named for tag in one.tags):
        return False
    if before is not None and one.created >= before:
        return False
    return only is None or bool(one.tags and one.repositories <= set(only))


def _steps(robot: str, one: StoredImage) -> Iterator[Step]:
    """Return a step for each name of an image, or for its id; the engine removes it with the last."""
    state = {"id": one.id, "steps": one.steps}
    for name in one.names:
        cause = "nobody uses it" if one.tags else "has no name, and nobody uses it"
        yield removal_step(robot, Observed(module="image", name=name, instance="", state=state), cause)
