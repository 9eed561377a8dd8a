"""A plan of an experiment -> what is there over all trials, and what each trial makes anew. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.labpolicy import Policies, enforce
from srprov.controller.ownership import owned
from srprov.controller.plan import Planned
from srprov.controller.trial_instances import with_instances
from srprov.controller.trial_values import design_notes
from srprov.definitions.model import Inventory
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import TransportError, UsageError, visible
from srprov.execution.trial_robots import TrialContainer
from srprov.modules import RUNNING
from srprov.modules.container_commands import creation
from srprov.modules.container_form import told
from srprov.modules.container_params import ContainerParams
from srprov.modules.mount_place import guarded
from srprov.planning.diff import diff
from srprov.planning.plan import Step
from srprov.resource import Observed, Resource
from srprov.trials import Trial

TRIAL = "srprov.trial"
"""Label of a trial's containers: the trial and its attempt."""

_MADE_ANEW = "each trial makes its own"


class TrialPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What is planned for trials."""

    base: Planned
    """All that is there over all trials."""
    services: tuple[Resource, ...]
    """The containers that each trial makes anew, as they are without trials."""
    given: TrialDefinitions
    """With conditions that name every instance of a service."""
    needs: Mapping[str, Mapping[str, str]]
    """Service of a trial -> services of the trial that it waits for, and for what."""
    origin: Mapping[str, str]
    """Service of a trial -> its name in the EDF."""

    @property
    def jobs(self) -> frozenset[str]:
        """The services that end by themselves, or may."""
        return frozenset(one.service for one in self.services if one.params.run.restart in ("", "no"))

    @property
    def robots(self) -> dict[str, str]:
        """Service of a trial -> the robot that it runs on."""
        return {one.service: one.host for one in self.services}

    @property
    def disks(self) -> dict[str, str]:
        """Robot -> where its Docker keeps its data."""
        facts = self.base.snapshot.facts if self.base.snapshot is not None else {}
        return {name: one.docker.root for name, one in facts.items() if one.docker is not None}


def trial_plan(planned: Planned, inventory: Inventory, policies: Policies, *, resume: bool = False) -> TrialPlan:
    """Divide what a plan wants into what is there over all trials and what each trial makes anew.

    Args:
        planned: What is wanted, and what was found.
        inventory: The robots.
        policies: What they allow.
        resume: Containers of trials that are there may be of one that ended meanwhile: they stay, unless something
            below them must change.

    Raises:
        TransportError: A robot that has a part in them cannot be reached.
        UsageError: A service that is kept waits for one that is not.
        RefusedError: A policy does not allow a container.
    """
    experiment = planned.experiment
    assert planned.snapshot is not None and experiment is not None  # a plan from a file has none, and no trials
    _check_reach(planned)
    given = with_instances(experiment)
    kept = set(given.settings.keep)
    ours = {name for name in experiment.services if name not in kept}
    for name in sorted(kept):
        if waits := sorted(experiment.services[name].depends_on.keys() & ours):
            raise UsageError(
                f"'{name}' is kept over all trials and waits for '{waits[0]}', which is not", code=Code.DEPENDENCY
            )
    moving = tuple(one for one in planned.desired if one.module in RUNNING and one.service in ours)
    rest = [one for one in planned.desired if one not in moving]
    instance = planned.plan.instance
    # each trial makes its containers anew, so a policy looks at all of them; an image that is there stays
    images = {
        host: [one for one in items if one.module == "image"] for host, items in planned.snapshot.observed.items()
    }
    enforce(replace(planned.plan, steps=diff(planned.desired, images, instance)[0]), inventory, policies)
    there = owned(planned.snapshot, instance)
    steps, unchanged = diff(rest, _without(there, ours) if resume else there, instance)
    if resume and steps:
        steps, unchanged = diff(rest, there, instance)
    base = _based(planned, _caused(steps, ours), unchanged, rest)
    needs = {
        name: {other: how for other, how in experiment.services[name].depends_on.items() if other in ours}
        for name in ours
    }
    origin = {name: experiment.services[name].instance_of or name for name in ours}
    return TrialPlan(base=base, services=moving, given=given, needs=needs, origin=origin)


def _based(planned: Planned, steps: tuple[Step, ...], unchanged: int, rest: Sequence[Resource]) -> Planned:
    """Return the plan of what is there over all trials."""
    plan = replace(planned.plan, steps=steps, unchanged=unchanged, notes=_notes(planned))
    return replace(planned, plan=plan, desired=tuple(rest))


def _notes(planned: Planned) -> tuple[str, ...]:
    """Return the plan's notes in the words of who runs all trials, not the first point alone."""
    trials = planned.definitions.experiment.trials if planned.definitions is not None else None
    words = dict(zip(design_notes(trials), design_notes(trials, run=True), strict=True))
    return tuple(words.get(note, note) for note in planned.plan.notes)


def _caused(steps: Sequence[Step], ours: Collection[str]) -> tuple[Step, ...]:
    """Return steps that say of the containers of the trials' services why they go: the experiment still has them."""
    return tuple(
        replace(step, change=replace(step.change, cause=_MADE_ANEW))
        if step.found is not None and step.module in RUNNING and step.found.service in ours
        else step
        for step in steps
    )


def _check_reach(planned: Planned) -> None:
    """Refuse trials without one of their services: one whose robot is away stays there, and is in no plan."""
    assert planned.snapshot is not None and planned.assignment is not None
    for service, robot in sorted(planned.assignment.placed.items()):
        if why := planned.snapshot.unreachable.get(robot):
            raise TransportError(
                robot, f"{service} runs there in each trial, and it cannot be reached: {why}", code=Code.NEEDED_ROBOT
            )


def _without(there: Mapping[str, Sequence[Observed]], services: Collection[str]) -> dict[str, list[Observed]]:
    """Return what is on each robot but for the containers of some services."""
    return {
        host: [one for one in items if one.module not in RUNNING or one.service not in services]
        for host, items in there.items()
    }


def containers(plan: TrialPlan, trial: Trial, attempt: int, run: str) -> list[TrialContainer]:
    """Return what one attempt of a trial runs."""
    return [_container(plan, one, trial, attempt, run) for one in plan.services]


def _container(plan: TrialPlan, one: Resource, trial: Trial, attempt: int, run: str) -> TrialContainer:
    settings, base = plan.given.settings, one.params
    assert isinstance(base, ContainerParams)
    own = {
        "SRPROV_RUN": run,
        "SRPROV_TRIAL": trial.id,
        "SRPROV_POINT": trial.point.id,
        "SRPROV_REPETITION": str(trial.repetition),
        "SRPROV_SEED": str(trial.seed),
    }
    set_here = {name: value for name, value in trial.point.values.items() if name in base.run.environment}
    grace = base.run.stop_grace_s if settings.stop_grace_s is None else settings.stop_grace_s
    runtime = replace(
        base.run,
        environment={**base.run.environment, **set_here, **own},
        stop_signal=settings.stop_signal or base.run.stop_signal,
        stop_grace_s=grace,
    )
    label = {TRIAL: f"{trial.id}.{attempt}"}
    want = replace(base, run=runtime)
    return TrialContainer(
        host=one.host,
        service=one.service,
        name=one.name,
        create=tuple(
            guarded(command, want.mounts, plan.base.plan.leads.get(one.host, {}))
            for command in creation(one.name, want, label)
        ),
        needs=plan.needs[one.service],
        grace_s=grace,
    )


def in_words(plan: TrialPlan) -> str:
    """Return what each trial creates, a line for each container, below its robot."""
    lines = ["Each trial makes these anew, and removes them:"]
    for host in sorted({one.host for one in plan.services}):
        lines += ["", host]
        for one in sorted((one for one in plan.services if one.host == host), key=lambda one: one.name):
            names = (one.service, plan.origin[one.service])
            kinds = sorted({asked.kind for asked in plan.base.plan.permissions if asked.service in names})
            asks = f"; asks for {', '.join(kinds)}" if kinds else ""
            lines.append(f"  + container {one.name}: {told(one.params)}{asks}")
    return "\n".join(visible(line) for line in lines)
