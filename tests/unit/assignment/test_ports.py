"""A robot's ports are a resource: what one service has there no other can have, whoever it is."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from srprov.assignment import problem, solve
from srprov.definitions.containermodel import Runtime
from srprov.definitions.expand import expand
from srprov.definitions.model import Placement, Service
from srprov.errors import NoAssignment, UsageError
from srprov.facts.model import TakenPort
from tests.unit.assignment.worlds import assign, experiment, found, robot, service

TWO_SLOTS = {"placement": Placement(slots_per_robot=2)}
BUSY = robot("r2", load1=4.0)


def web(name: str, address: str = "", port: int = 8080, protocol: str = "tcp", **fields: object) -> Service:
    return service(name, runtime=Runtime(ports=((address, port, 80, protocol),)), **fields)


def listening(name: str, port: int = 8080) -> Service:
    return service(name, network="host", runtime=Runtime(expose=((port, "tcp"),)))


SHARE = [
    (web("a"), web("b"), False),
    (web("a"), web("b", "127.0.0.1"), False),
    (web("a", "0.0.0.0"), web("b", "10.0.0.1"), False),
    (web("a", "::"), web("b", "10.0.0.1"), False),
    (web("a", "10.0.0.1"), web("b", "10.0.0.1"), False),
    (web("a", "10.0.0.1"), web("b", "127.0.0.1"), True),
    (web("a"), web("b", protocol="udp"), True),
    (web("a"), web("b", port=8081), True),
    (web("a"), listening("b"), False),
    (listening("a"), listening("b"), False),
    (listening("a"), listening("b", 8081), True),
    (web("a"), service("b", runtime=Runtime(expose=((8080, "tcp"),))), True),
]


@pytest.mark.parametrize(("one", "other", "together"), SHARE)
def test_two_services_share_a_robot_only_where_their_ports_let_them(
    one: Service, other: Service, together: bool
) -> None:
    """The busy robot costs more, so both would be on the idle one."""
    placed = assign(experiment(one, other, **TWO_SLOTS), found(robot("r1"), BUSY)).placed
    assert (len(set(placed.values())) == 1) is together


def test_replicas_that_publish_a_port_run_on_robots_of_their_own() -> None:
    what = expand(experiment(web("web", replicas=2), **TWO_SLOTS), {"r1": (), "r2": ()})
    assert sorted(assign(what, found(robot("r1"), BUSY)).placed.values()) == ["r1", "r2"]


def test_a_refusal_says_which_port_both_publish() -> None:
    what = expand(experiment(web("web", replicas=2), **TWO_SLOTS), {"r1": ()})
    with pytest.raises(NoAssignment, match="'web-1' and 'web-2' both publish 8080/tcp") as caught:
        assign(what, found(robot("r1")))
    assert "add one more robot" in caught.value.hint
    assert "publish 8080/tcp of 'web' once at most" in caught.value.hint


def test_robots_of_one_slot_need_no_large_solver() -> None:
    """They keep everything apart by themselves."""
    what = expand(experiment(web("web", replicas=2)), {"r1": (), "r2": ()})
    made = problem.build(what, {}, found(robot("r1"), robot("r2")), {})
    assert made.anti_affinity
    assert made.kept_apart == ()
    assert sorted(solve.solve(made).placed.values()) == ["r1", "r2"]


def test_services_that_must_share_a_robot_and_a_port_are_refused() -> None:
    what = experiment(web("a"), web("b"), same_robot=(("a", "b"),))
    with pytest.raises(UsageError, match="'a' and 'b' must share a robot, and both publish 8080/tcp"):
        assign(what, found(robot("r1")))


def test_a_service_on_every_robot_has_its_port_on_each() -> None:
    everywhere = web("agent", per_robot=("arm",))
    what = expand(experiment(everywhere, web("b"), **TWO_SLOTS), {"r1": ("arm",), "r2": ()})
    answer = assign(what, found(robot("r1", tags=("arm",)), BUSY))
    assert answer.placed["b"] == "r2"
    assert answer.why_not["b"]["r1"] == "port 8080/tcp is taken by 'agent-r1'"


def test_two_services_on_every_robot_with_one_port_are_refused() -> None:
    what = expand(experiment(web("a", per_robot=()), web("b", per_robot=())), {"r1": ()})
    with pytest.raises(NoAssignment, match="r1 cannot run 'a-r1', which 'per_robot' puts there") as caught:
        assign(what, found(robot("r1")))
    assert caught.value.misses["a-r1"]["r1"] == "port 8080/tcp is taken by 'b-r1'"


TAKEN = TakenPort(address="", port=8080, protocol="tcp", by="container grafana")


def test_a_port_that_somebody_else_has_keeps_a_service_away() -> None:
    answer = assign(experiment(web("a")), found(robot("r1"), BUSY), taken={"r1": (TAKEN,)})
    assert answer.placed == {"a": "r2"}
    assert answer.why_not["a"]["r1"] == "port 8080/tcp is taken by container grafana"
    apart = replace(TAKEN, address="127.0.0.1")
    assert assign(experiment(web("a", "10.0.0.1")), found(robot("r1")), taken={"r1": (apart,)}).placed == {"a": "r1"}


def test_when_every_robot_has_the_port_taken_the_refusal_names_who_has_it() -> None:
    with pytest.raises(NoAssignment) as caught:
        assign(experiment(web("a")), found(robot("r1")), taken={"r1": (TAKEN,)})
    assert caught.value.misses == {"a": {"r1": "port 8080/tcp is taken by container grafana"}}
    assert "publish another port than 8080/tcp in 'a'" in caught.value.hint
