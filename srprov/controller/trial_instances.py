"""What an EDF says of trials, in the names of all instances that its services have. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import Experiment
from srprov.definitions.trialsmodel import Conditions, TrialDefinitions
from srprov.errors import UsageError


def with_instances(experiment: Experiment) -> TrialDefinitions:
    """Return it for an experiment that has every instance as a service of its own.

    Raises:
        UsageError: A metric is of a service of which there are several: it would be several numbers.
    """
    given = experiment.trials or TrialDefinitions()
    instances: dict[str, list[str]] = {}
    for name, service in sorted(experiment.services.items()):
        instances.setdefault(service.instance_of or name, []).append(name)
    if all(some == [name] for name, some in instances.items()):
        return given
    for metric in given.metrics:
        if len(some := instances.get(metric.service, [])) != 1:
            message = f"the metric '{metric.name}' is of '{metric.service}', of which there are {len(some)}"
            raise UsageError(
                message, hint="name one of them as a service of its own in the EDF", code=Code.TRIAL_JUDGING
            )

    def every(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(one for name in names for one in instances.get(name, ()))

    def conditions(given: Conditions | None) -> Conditions | None:
        items = given.items if given else ()
        return given and replace(given, items=tuple(replace(one, services=every(one.services)) for one in items))

    settings = replace(
        given.settings,
        until=conditions(given.settings.until),
        success=conditions(given.settings.success),
        stop_first=every(given.settings.stop_first),
        keep=every(given.settings.keep),
    )
    metrics = tuple(replace(one, service=instances[one.service][0]) for one in given.metrics)
    return replace(given, settings=settings, metrics=metrics, results=MappingProxyType(dict(given.results)))
