"""Profiles: which of an experiment's services a user wants this time.

Takes definitions as they were read, and the profiles that the user named; gives the definitions with the services that
are wanted alone. A service without `profiles` always is; one with them is when one of them is named, or `*`. Pure.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import values
from srprov.definitions.model import Definitions, Experiment, Service
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import DefinitionError, Diagnostic, UsageError, did_you_mean
from srprov.yamldoc import loader, nodes

EVERY = "*"
_Off = Mapping[str, Service]


def chosen(definitions: Definitions, wanted: Collection[str]) -> Definitions:
    """Return the definitions without the services whose profiles are off.

    Raises:
        UsageError: No service has such a profile.
        DefinitionError: Something that is wanted names a service whose profile is off.
    """
    experiment = definitions.experiment
    known = {name for one in experiment.services.values() for name in one.profiles}
    for name in sorted(set(wanted) - known - {EVERY}):
        hint = did_you_mean(name, known) or (f"known: {', '.join(sorted(known)[:12])}" if known else "there are none")
        raise UsageError(f"no service has the profile '{name[:60]}'", hint=hint, code=Code.NO_SUCH_NAME)
    off = {} if EVERY in wanted else {one.name: one for one in experiment.services.values() if _is_off(one, wanted)}
    if not off:
        return definitions
    if problems := tuple(_needed(experiment, off)):
        raise DefinitionError(problems)
    left = _without(experiment, off)
    used = {one.cdf for one in left.services.values()}
    return replace(
        definitions,
        experiment=left,
        containers={key: one for key, one in definitions.containers.items() if key in used},
        notes=(*definitions.notes, f"not wanted, as their profiles are off: {_in_words(off.values())}"),
    )


def _is_off(one: Service, wanted: Collection[str]) -> bool:
    return bool(one.profiles) and not set(one.profiles) & set(wanted)


def _in_words(services: Iterable[Service]) -> str:
    return ", ".join(f"{one.name} ({' or '.join(one.profiles)})" for one in services)


def _needed(experiment: Experiment, off: _Off) -> Iterator[Diagnostic]:
    """Return a problem for each place where something that is wanted names a service that is not."""
    root = loader.parse(experiment.text, experiment.file)
    for path, name in (*_waits(experiment, off), *_servers(experiment), *_ends(experiment)):
        if name in off:
            hint = f"--profile {off[name].profiles[0]}, or leave it out here"
            message = f"'{name}' is not wanted: its profile {' or '.join(off[name].profiles)} is off"
            place = nodes.find(root, path) if root else None
            if isinstance(place, nodes.Seq):
                place = next((item for item in place.items if values.text(item) == name), place)
            if place:
                yield nodes.problem(place, message, path, hint, code=Code.DEPENDENCY)


def _waits(experiment: Experiment, off: _Off) -> Iterator[tuple[nodes.Path, str]]:
    for one in experiment.services.values():
        for other in one.depends_on if one.name not in off else ():
            yield ("services", one.name, "depends_on", other), other


def _servers(experiment: Experiment) -> Iterator[tuple[nodes.Path, str]]:
    yield from ((("network", "discovery_servers"), name) for name in experiment.network.discovery_servers)


def _ends(experiment: Experiment) -> Iterator[tuple[nodes.Path, str]]:
    """Return the services by which trials end or succeed; a metric's too."""
    if experiment.trials is None:
        return
    services = {one.name: one.service for one in experiment.trials.metrics}
    settings = experiment.trials.settings
    for key, conditions in (("until", settings.until), ("success", settings.success)):
        for one in conditions.items if conditions else ():
            yield from ((("trials", key), name) for name in (*one.services, services.get(one.metric, "")))


def _left(names: Iterable[str], off: _Off) -> tuple[str, ...]:
    return tuple(name for name in names if name not in off)


def _without(experiment: Experiment, off: _Off) -> Experiment:
    def groups(given: Iterable[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
        return tuple(left for group in given if len(left := _left(group, off)) > 1)

    pools = (replace(pool, services=_left(pool.services, off)) for pool in experiment.pools)
    return replace(
        experiment,
        services={name: one for name, one in experiment.services.items() if name not in off},
        same_robot=groups(experiment.same_robot),
        different_robot=groups(experiment.different_robot),
        pools=tuple(pool for pool in pools if len(pool.services) > 1),
        # what was read of an unwanted one a record has, and then a bundle
        outside=tuple(one for one in experiment.outside if one[0] not in off or one[1] in experiment.read_outside),
        remote=tuple(one for one in experiment.remote if one[0] not in off),
        environment=tuple(one for one in experiment.environment if one[0] not in off),
        trials=_trials(experiment.trials, off) if experiment.trials else None,
    )


def _trials(given: TrialDefinitions, off: _Off) -> TrialDefinitions:
    settings = given.settings
    return replace(
        given,
        parameters=tuple(
            one if one.services is None else replace(one, services=_left(one.services, off)) for one in given.parameters
        ),
        settings=replace(settings, keep=_left(settings.keep, off), stop_first=_left(settings.stop_first, off)),
        results={name: one for name, one in given.results.items() if name not in off},
        metrics=tuple(one for one in given.metrics if one.service not in off),
    )
