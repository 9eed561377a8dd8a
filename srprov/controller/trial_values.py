"""An experiment at one point of its parameters. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from msgspec.structs import replace

from srprov.definitions.model import Definitions, Experiment, Service
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.trials import Design, design


def at_first_point(definitions: Definitions) -> Definitions:
    """Return the definitions with the first point's values, which is what `apply` brings up.

    Raises:
        UsageError: The design has too many trials, or none.
    """
    given = definitions.experiment.trials
    if given is None or not given.parameters:
        return definitions
    values = design(given).points[0].values
    return replace(definitions, experiment=_with_values(definitions.experiment, given, values))


def _with_values(experiment: Experiment, given: TrialDefinitions, values: Mapping[str, str]) -> Experiment:
    services = {name: _service(one, given, values) for name, one in experiment.services.items()}
    return replace(experiment, services=MappingProxyType(services))


def _service(service: Service, given: TrialDefinitions, values: Mapping[str, str]) -> Service:
    if service.name in given.settings.keep:
        return service
    mine = {
        one.name: values[one.name] for one in given.parameters if one.services is None or service.name in one.services
    }
    run = replace(service.runtime, environment={**service.runtime.environment, **mine})
    return replace(service, runtime=run)


def design_notes(given: TrialDefinitions | None, *, run: bool = False) -> tuple[str, ...]:
    """Return what a plan says of trials; `run`: one that `srprov run` shows, which runs them all."""
    if given is None or not (given.parameters or given.settings.repetitions > 1):
        return ()
    from srprov.trials import power

    made = design(given)
    if run:
        return (in_words(given, made), *power.in_words(given, made))
    first = ", ".join(f"{name}={value}" for name, value in made.points[0].values.items())
    here = f"; here with {first}" if first else ""
    return (f"{in_words(given, made)}; `srprov run` runs them{here}", *power.in_words(given, made))


def size_note(given: TrialDefinitions) -> str:
    """Return the size of a design of which `design_notes` says nothing, for who runs it all the same; else nothing."""
    return "" if design_notes(given) else in_words(given, design(given))


def listed(experiment: Experiment) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Return a row per trial, in order, as `schemas/trials.schema.json` has it; the design's size and power in words.

    Raises:
        UsageError: The design has too many trials, or none.
    """
    from srprov.trials import power

    given = experiment.trials or TrialDefinitions()
    made = design(given)
    rows = [
        {
            "order": order,
            "trial": trial.id,
            "point": trial.point.id,
            "repetition": trial.repetition,
            "seed": trial.seed,
            "parameters": dict(trial.point.values),
        }
        for order, trial in enumerate(made.trials, start=1)
    ]
    return rows, (in_words(given, made), *power.in_words(given, made))


def in_words(given: TrialDefinitions, made: Design) -> str:
    """Return the size of a design, and how long it may take."""
    settings = given.settings
    longest = settings.ready_s + settings.settle_s + settings.timeout_s + (settings.stop_grace_s or 10.0)
    order = f"in random order (seed {settings.seed})" if settings.order == "random" else "as listed"
    points = f"{len(made.points)} point{'s' if len(made.points) > 1 else ''}"
    times = f"{settings.repetitions} repetition{'s' if settings.repetitions > 1 else ''}"
    seconds = len(made.trials) * (longest + settings.pause_s)
    trials = f"{len(made.trials)} trial{'s' if len(made.trials) != 1 else ''}"
    return f"{points} x {times} = {trials}, {order}, at most {_duration(seconds)}"


def _duration(seconds: float) -> str:
    minutes, hours = round(seconds) // 60, round(seconds) // 3600
    if hours:
        return f"{hours} h {minutes % 60} min"
    return f"{minutes} min {round(seconds) % 60} s" if minutes else f"{round(seconds)} s"
