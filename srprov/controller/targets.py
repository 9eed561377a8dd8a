"""The part of a plan that is about some services: `--target`. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from srprov.controller.named_services import services_of
from srprov.controller.plan import Planned
from srprov.planning.target import targeted


def only_targets(planned: Planned, words: Sequence[str]) -> Planned:
    """Return what was planned with the steps of some services and what they need; without words, all of it.

    The placement stays that of the whole experiment.

    Raises:
        UsageError: A word names no service.
        RefusedError: It cannot be done without touching others.
    """
    if not words:
        return planned
    assert planned.experiment is not None  # a plan of an experiment: those of files and removals have no targets
    here = {step.service for step in planned.plan.steps if step.want is None} - {""}
    gone = here - planned.experiment.services.keys()
    names = services_of(words, planned.experiment, planned.plan.assignment, gone)
    plan = targeted(planned.plan, planned.desired, names)
    return replace(planned, plan=plan, whole=planned.whole or planned.plan, targets=names)
