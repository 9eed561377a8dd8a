"""`pull_policy: always`: what tags are at the time of a plan.

Takes the placement and a way to ask robots; gives definitions with digests.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msgspec.structs import replace

from srprov.controller.digests import AskEach, look_up
from srprov.controller.pins import names_of, pinned, pinned_services
from srprov.definitions.lockfile import Lock
from srprov.definitions.model import Definitions, Experiment


def with_fresh(
    definitions: Definitions,
    experiment: Experiment,
    placed: Mapping[str, str],
    reachable: Collection[str],
    ask: AskEach,
    allowed: Collection[str],
) -> tuple[Definitions, Experiment, tuple[str, ...]]:
    """Return definitions and experiment with the digests that the tags of services with `always` have now, and notes.

    The digest stands in the plan. What a lock holds is not looked up. Of what one robot alone says, there is a note.

    Args:
        definitions: What was read.
        experiment: The experiment with a service for each replica.
        placed: Service -> robot.
        reachable: Robots that answer.
        ask: Asks robots.
        allowed: Kinds of permission that the user gave.

    Raises:
        RefusedError: As `look_up` says.
        UsageError: No registry tells it, or robots disagree.
    """
    fresh = {name: one for name, one in experiment.services.items() if one.runtime.pull_policy == "always"}
    keys = {one.cdf for one in fresh.values()}
    # a definition has one digest for all that use it: no robot alone says what others get
    using = {name for name, one in experiment.services.items() if name in fresh or (one.cdf and one.cdf in keys)}
    robots = {placed[name] for name in using if placed.get(name) in reachable}
    if not any(placed.get(name) in reachable for name in fresh):
        return definitions, experiment, ()
    mine = replace(
        definitions,
        experiment=replace(experiment, services=fresh, remote=()),
        containers={key: one for key, one in definitions.containers.items() if key in keys},
    )
    notes: list[str] = []
    found = look_up(ask, robots, names_of(mine).images, allowed, notes.append)
    digests = {name: digest for name, (digest, _) in found.items()}
    fixed = pinned(mine, Lock(digests=digests, platforms={name: one for name, (_, one) in found.items()}))
    containers = {**definitions.containers, **fixed.containers}
    platforms = {**definitions.platforms, **fixed.platforms}
    services = {**experiment.services, **pinned_services(mine.experiment, digests).services}
    definitions = replace(definitions, containers=containers, platforms=platforms)
    return definitions, replace(experiment, services=services), tuple(notes)
