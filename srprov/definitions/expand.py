"""Replicas and `per_robot`: one service of the EDF -> the instances that run.

Takes an Experiment as it was read, and the robots there are with their tags; gives an Experiment in which every service
runs once. Pure; run once, after the robots have been asked, before anything is decided. A replica is named NAME-1 to
NAME-n, an instance of `per_robot` NAME-ROBOT. Whatever names the service (dependencies, pools, relations) then names
all its instances.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.containermodel import Runtime
from srprov.definitions.model import Experiment, Pool, Service
from srprov.errors import UsageError

_LONGEST = 63
"""Characters of a container's host name."""
_MOST_INSTANCES = 10_000
_MOST_WAITS = 100_000
"""Dependencies of all instances: each of a service's waits for each of another's."""
_MOST_BYTES = 16 << 20
"""Of what containers are told to run with, all instances together: plans hold it once for each."""


def expand(
    experiment: Experiment, tags: Mapping[str, Iterable[str]], previous: Mapping[str, str] = MappingProxyType({})
) -> Experiment:
    """Return the experiment with every instance as a service of its own.

    Args:
        experiment: As it was read.
        tags: Reachable robot -> its tags.
        previous: Service -> the robot out of reach that it runs on; an instance there is not forgotten.

    Raises:
        UsageError: An instance would have the name of another service, or too long a name.
    """
    has = {robot: set(some) for robot, some in tags.items()}
    _check_size(experiment.services, has)
    if not any(one.replicas != 1 or one.per_robot is not None for one in experiment.services.values()):
        return experiment
    instances = {name: _instances(one, has, previous) for name, one in experiment.services.items()}
    _check(experiment, instances)
    services = [replace(one, depends_on=_depends_on(one, instances)) for some in instances.values() for one in some]
    names = {name: tuple(one.name for one in some) for name, some in instances.items()}
    return replace(
        experiment,
        services=MappingProxyType({one.name: one for one in sorted(services, key=lambda one: one.name)}),
        same_robot=_groups(experiment.same_robot, names),
        different_robot=_groups(experiment.different_robot, names),
        pools=tuple(_pool(pool, names) for pool in experiment.pools if len(_all(pool.services, names)) > 1),
    )


def _check_size(services: Mapping[str, Service], tags: Mapping[str, set[str]]) -> None:
    """Refuse what becomes very much of little: some instances more than there are, on robots out of reach, do no harm.

    Raises:
        UsageError: It says what there is too much of.
    """
    counts = {
        name: one.replicas if one.per_robot is None else sum(has >= set(one.per_robot) for has in tags.values())
        for name, one in services.items()
    }
    waits = sum(counts[name] * sum(counts.get(n, 0) for n in one.depends_on) for name, one in services.items())
    told = sum(counts[name] * len(msgspec.json.encode(one.runtime, enc_hook=dict)) for name, one in services.items())
    for what, found, most in (
        ("instances of services", sum(counts.values()), _MOST_INSTANCES),
        ("dependencies between instances", waits, _MOST_WAITS),
        ("bytes that containers are told to run with", told, _MOST_BYTES),
    ):
        if found > most:
            raise UsageError(
                f"the experiment has {found} {what}; {most} are the most",
                hint="give it fewer replicas, or ship long texts as files",
                code=Code.TOO_LARGE,
            )


def nowhere(experiment: Experiment, expanded: Iterable[Service], *, away: bool) -> tuple[str, ...]:
    """Return a note for each service with `per_robot` that no robot matched, so that it has no instance.

    Args:
        experiment: As it was read.
        expanded: The services that `expand` made of it.
        away: Some robots are out of reach, so their tags are not known.
    """
    there = {one.instance_of for one in expanded}
    who = "no robot in reach" if away else "no robot"
    notes = []
    for name, service in sorted(experiment.services.items()):
        if service.per_robot is None or name in there:
            continue
        tags = ", ".join(f"'{tag}'" for tag in service.per_robot)
        has = f"{who} has the tag{'s' if len(service.per_robot) > 1 else ''} {tags}" if tags else f"there is {who}"
        notes.append(f"{has}, so '{name}' runs nowhere")
    return tuple(notes)


def _instances(service: Service, tags: Mapping[str, set[str]], previous: Mapping[str, str]) -> list[Service]:
    if service.per_robot is not None:
        robots = {robot for robot, has in tags.items() if has >= set(service.per_robot)}
        away = {robot for name, robot in previous.items() if robot not in tags and name == _named(service.name, robot)}
        return [
            replace(service, name=_named(service.name, robot), robot=robot, instance_of=service.name)
            for robot in sorted(robots | away)
        ]
    if service.replicas == 1:
        return [service]
    return [
        replace(
            service,
            name=f"{service.name}-{number}",
            replicas=1,
            instance_of=service.name,
            runtime=_own_volumes(service.runtime, number),
            by_cdf=frozenset(f"{volume}-{number}" for volume in service.by_cdf),
        )
        for number in range(1, service.replicas + 1)
    ]


def _own_volumes(runtime: Runtime, number: int) -> Runtime:
    """Return a replica's run-time fields: each has named volumes of its own, on whichever robot it is."""
    mounts = tuple(
        replace(mount, source=f"{mount.source}-{number}") if mount.kind == "volume" else mount
        for mount in runtime.mounts
    )
    return replace(runtime, mounts=mounts)


def _named(service: str, robot: str) -> str:
    """Return an instance's name; it is a host name and part of a container's, so a robot's name is made to fit."""
    return f"{service}-{re.sub(r'[^a-z0-9_-]', '-', robot.lower()).strip('-_') or 'robot'}"


def _check(experiment: Experiment, instances: Mapping[str, Sequence[Service]]) -> None:
    seen: dict[str, str] = {}
    for name, some in sorted(instances.items()):
        for one in some:
            if one.name in seen or (one.name != name and one.name in experiment.services):
                raise UsageError(
                    f"two services would be named '{one.name}'", hint=f"rename '{name}' in the EDF", code=Code.NAME
                )
            if len(one.name) > _LONGEST:
                raise UsageError(
                    f"'{one.name}' is longer than {_LONGEST} characters",
                    hint=f"give '{name}' a shorter name",
                    code=Code.NAME,
                )
            seen[one.name] = name


def _depends_on(service: Service, instances: Mapping[str, Sequence[Service]]) -> Mapping[str, str]:
    waits = {one.name: how for other, how in service.depends_on.items() for one in instances.get(other, ())}
    return MappingProxyType(dict(sorted(waits.items())))


def _all(group: Iterable[str], names: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    return tuple(sorted(instance for name in group for instance in names.get(name, ())))


def _groups(groups: Iterable[Sequence[str]], names: Mapping[str, Sequence[str]]) -> tuple[tuple[str, ...], ...]:
    return tuple(sorted(every for group in groups if len(every := _all(group, names)) > 1))


def _pool(pool: Pool, names: Mapping[str, Sequence[str]]) -> Pool:
    return replace(pool, services=_all(pool.services, names))
