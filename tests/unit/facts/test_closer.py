"""How closely robots are looked at: no closer than what is to be decided needs."""

from __future__ import annotations

import dataclasses

import pytest

from srprov.definitions.model import Placement, Requirements
from srprov.facts.probes import COUNTERS, INFO
from tests.fakes import World
from tests.worlds import Experiment, apply, experiment, plan_for, service

PINNED = experiment(service("talker", robot="a"), service("listener", robot="b"))
FREE = experiment(service("talker"), service("listener"))


def asked(world: World, what: Experiment, **wishes: object) -> tuple[int, int]:
    """Plan, and give how often engines were asked of themselves, and how often traffic was measured."""
    before = len(world.log)
    plan_for(world, what, **wishes)
    queries = [entry.what for entry in world.log[before:]]
    return queries.count(INFO), queries.count(COUNTERS)


@pytest.fixture
def world() -> World:
    return World().add("a", "b")


def test_what_is_new_and_pinned_needs_the_engines_and_no_traffic(world: World) -> None:
    assert asked(world, PINNED) == (2, 0)


def test_a_choice_needs_the_traffic(world: World) -> None:
    assert asked(world, FREE) == (2, 2)
    half = experiment(service("talker", robot="a"), service("listener"))
    assert asked(world, half) == (2, 2)


@pytest.mark.parametrize("what", [PINNED, FREE])
def test_what_is_there_already_needs_neither(world: World, what: Experiment) -> None:
    apply(world, what)
    assert asked(world, what) == (0, 0)


def test_what_may_move_is_a_choice(world: World) -> None:
    apply(world, FREE)
    assert asked(world, FREE, reassign=True) == (2, 2)
    roaming = dataclasses.replace(FREE, placement=Placement(slots_per_robot=8, sticky=False))
    assert asked(world, roaming) == (2, 2)


def test_a_size_of_disk_asks_the_engines_which_disk_is_theirs_at_once(world: World) -> None:
    large = experiment(service("talker", robot="a", requires=Requirements(disk=1 << 20)))
    apply(world, large)
    assert asked(world, large) == (2, 0)


def test_whoever_prepares_changes_is_told_the_pinned_robots_once_and_only_when_something_is_new(world: World) -> None:
    told: list[frozenset[str]] = []
    plan_for(world, PINNED, expect=told.append)
    assert told == [frozenset({"a", "b"})]
    apply(world, PINNED)
    plan_for(world, PINNED, expect=told.append)
    assert len(told) == 1
    plan_for(world, experiment(service("talker", robot="a"), service("third")), expect=told.append)
    assert told[1:] == [frozenset()]
