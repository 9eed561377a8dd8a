"""How closely robots are looked at: no closer than what is to be decided needs."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence

import pytest
from msgspec.structs import replace

from srprov.definitions.containermodel import Requirements
from srprov.definitions.model import Placement
from srprov.errors import NoAssignment
from srprov.facts.first_look import ask
from srprov.facts.gather import Detail, Gathering
from srprov.facts.probes import INFO
from srprov.wire import EngineQuery, Query, Reply
from tests.fakes import World
from tests.worlds import Experiment, apply, experiment, inventory, plan_for, service

PINNED = experiment(service("talker", robot="a"), service("listener", robot="b"))
FREE = experiment(service("talker"), service("listener"))


def asked(world: World, what: Experiment, **wishes: object) -> tuple[int, int]:
    """Plan, and give how often engines were asked of themselves, and how often traffic was measured."""
    before = len(world.log)
    plan_for(world, what, **wishes)
    queries = [entry.what for entry in world.log[before:]]
    return queries.count(INFO), len(readings(queries))


def readings(queries: Sequence[object]) -> list[str]:
    """Return the commands that read the counters a second time."""
    every = [query.command for query in queries if isinstance(query, Query)]
    return [command for command in every if command.endswith("cat /proc/uptime /proc/net/dev")]


@pytest.fixture
def world() -> World:
    return World().add("a", "b")


def test_what_is_new_and_pinned_needs_the_engines_and_no_traffic(world: World) -> None:
    assert asked(world, PINNED) == (2, 0)


@pytest.mark.parametrize("again", [False, True])
def test_what_a_change_needs_is_got_ready_while_robots_are_asked_again_and_else_not_at_all(
    world: World, again: bool
) -> None:
    ready = threading.Event()
    with Gathering(inventory(world), world.reader, meanwhile=ready.set) as look:
        look.closer(Detail.ENGINE if again else Detail.BASIC)
    assert ready.wait(5) if again else not ready.is_set()


def test_a_choice_needs_the_traffic(world: World) -> None:
    assert asked(world, FREE) == (2, 2)
    half = experiment(service("talker", robot="a"), service("listener"))
    assert asked(world, half) == (2, 2)


def test_a_robot_is_told_when_its_counters_were_read_first(world: World) -> None:
    plan_for(world, FREE)
    told = readings([entry.what for entry in world.log])
    assert {command.splitlines()[0] for command in told} == {"first=500025"}


@pytest.mark.parametrize("what", [PINNED, FREE])
def test_what_is_there_already_needs_neither(world: World, what: Experiment) -> None:
    apply(world, what)
    assert asked(world, what) == (0, 0)


def test_what_may_move_is_a_choice(world: World) -> None:
    apply(world, FREE)
    assert asked(world, FREE, reassign=True) == (2, 2)
    roaming = replace(FREE, placement=Placement(slots_per_robot=8, sticky=False))
    assert asked(world, roaming) == (2, 2)


def test_a_size_of_disk_asks_the_engines_which_disk_is_theirs_at_once(world: World) -> None:
    large = experiment(service("talker", robot="a", requires=Requirements(disk=1 << 20)))
    apply(world, large)
    assert asked(world, large) == (2, 0)


def rootless(world: World, name: str) -> None:
    """Let an engine say that it runs without root."""
    engine = world.robots[name].engine
    query = engine.query

    def answer(asked: EngineQuery) -> Reply:
        reply = query(asked)
        if asked.path != "/info":
            return reply
        return replace(reply, out=json.dumps({**json.loads(reply.out), "SecurityOptions": ["name=rootless"]}))

    engine.query = answer  # type: ignore[method-assign]


def test_a_service_that_is_pinned_elsewhere_is_not_moved_to_a_rootless_engine(world: World) -> None:
    apply(world, FREE)
    there = plan_for(world, FREE).assignment["talker"]
    other = "b" if there == "a" else "a"
    rootless(world, other)
    moved = experiment(service("talker", robot=other), service("listener"))
    with pytest.raises(NoAssignment, match="no robot can run 'talker'"):
        plan_for(world, moved)


def test_a_service_that_must_move_is_a_choice() -> None:
    world = World().add("a").add("b", "c", arch="aarch64")
    apply(world, experiment(service("talker", robot="a")))
    arm = experiment(service("talker", requires=Requirements(arch=("arm64",))))
    assert asked(world, arm) == (3, 3)
    rootless(world, "b")
    assert plan_for(world, arm).assignment == {"talker": "c"}


def test_a_container_that_is_gone_is_new_to_its_robot(world: World) -> None:
    apply(world, PINNED)
    world.robots["a"].engine.containers.clear()
    assert asked(world, PINNED) == (2, 0)
    rootless(world, "a")
    with pytest.raises(NoAssignment):
        plan_for(world, PINNED)


def test_a_plan_file_holds_engines_to_what_they_say_of_themselves(world: World) -> None:
    apply(world, PINNED)
    assert asked(world, PINNED, exact=True) == (2, 0)


@pytest.mark.parametrize("closely", [False, True])
def test_a_robot_whose_engine_is_silent_counts_as_out_of_reach_when_services_were_placed_there(
    world: World, closely: bool
) -> None:
    """Its containers may well run: what cannot be seen must not pass for gone, however closely robots are looked at."""
    apply(world, PINNED)
    world.robots["a"].engine.down = True
    made = plan_for(world, PINNED, reassign=closely)
    assert set(made.unreachable) == {"a"}
    assert "its Docker Engine does not answer" in made.unreachable["a"]
    assert made.assignment["talker"] == "a"


def test_an_engine_that_gets_another_container_is_asked_of_itself(world: World) -> None:
    """How it keeps logs by default is known only from that; who gets none is not asked."""
    apply(world, PINNED)
    other = experiment(service("talker", robot="a", command=("x",)), service("listener", robot="b"))
    assert asked(world, other) == (1, 0)
    plan = plan_for(world, other)
    (step,) = (step for step in plan.steps if step.module == "container")
    assert '"LogConfig":{"Config":{"max-file":"3","max-size":"10m"},"Type":"json-file"}' in step.commands[-2].text()


def test_what_is_kept_of_first_answers_is_without_placement_records() -> None:
    """Those were read; each names all robots, so that the texts would take the square of memory."""
    world = World().add("r1")
    apply(world, experiment(service("a", robot="r1")))
    (host,) = inventory(world).hosts.values()
    answers = ask(host, world.reader, engine=False)
    assert answers.placements["hello"]["services"].keys() == {"a"}
    kept = "".join(reply.out for reply in answers.replies)
    assert "placement.json" not in kept and "/proc/uptime:" in kept
