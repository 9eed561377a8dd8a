"""Trials remove what has their containers' names, but nothing that somebody else made since their plan was shown."""

from __future__ import annotations

from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller.trial_others import refuse_others
from srprov.controller.trial_plan import TrialPlan, trial_plan
from srprov.definitions.model import Definitions, Experiment
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import RefusedError, TransportError
from tests.fakes import World
from tests.worlds import AS_IT_IS, apply, experiment, inventory, made, plan, service

WHAT = experiment(service("racer", robot="r1"), service("far", robot="r2"), trials=TrialDefinitions())


def shown(world: World, source: str, what: Experiment = WHAT, *, adopt: bool = False) -> TrialPlan:
    """Return what `run` shows of an EDF somewhere."""
    with mock.patch.object(plan, "source_of", return_value=source):
        planned = made(world, Definitions(experiment=what, containers={}), replace(AS_IT_IS, adopt=adopt))
    return trial_plan(planned, inventory(world), ())


def test_a_container_that_somebody_else_made_since_is_not_removed() -> None:
    world = World().add("r1", "r2")
    mine, strange = shown(world, f"lab@desk:{WHAT.file}"), shown(world, "x@y:/z.edf")
    refuse_others(strange, world.sessions())  # nothing is there
    assert apply(world, WHAT).exit_code == 0
    with pytest.raises(RefusedError, match=r"srprov\.hello\.racer on r1 is there, made from lab@desk:") as refused:
        refuse_others(strange, world.sessions())
    assert refused.value.exit_code == 9
    refuse_others(mine, world.sessions())  # of a run that was killed, perhaps


def test_what_was_there_when_it_was_shown_was_adopted() -> None:
    world = World().add("r1", "r2")
    assert apply(world, WHAT).exit_code == 0
    refuse_others(shown(world, "x@y:/z.edf", adopt=True), world.sessions())


def test_no_trial_is_made_inside_of_what_somebody_else_made_since() -> None:
    """Its container has another name: it would be in the network of the other experiment."""
    world = World().add("r1", "r2")
    strange = shown(world, "x@y:/z.edf", experiment(service("evil", robot="r2"), trials=TrialDefinitions()))
    assert apply(world, experiment(service("racer", robot="r1"), trials=TrialDefinitions())).exit_code == 0
    with pytest.raises(RefusedError, match=r"r2 changed since .* made from lab@desk:.*; nothing was done"):
        refuse_others(strange, world.sessions())


def test_a_robot_that_does_not_say_what_runs_there_gets_no_trial() -> None:
    world = World().add("r1", "r2")
    strange = shown(world, "x@y:/z.edf")
    world.robots["r2"].engine.unreadable.add("/containers/json")
    with pytest.raises(TransportError, match=r"its containers cannot be listed: .* cannot be read"):
        refuse_others(strange, world.sessions())
