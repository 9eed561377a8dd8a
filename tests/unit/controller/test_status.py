"""What `status` says of an instance: what is there, and what should be there and is not."""

from __future__ import annotations

import json
from typing import Any
from unittest import mock

from msgspec.structs import replace

from srprov.controller import ownership
from srprov.controller.located import containers_of
from srprov.controller.status import Status, status_of
from srprov.definitions.model import Experiment
from srprov.definitions.trialsmodel import TrialDefinitions, TrialSettings
from srprov.facts.gather import Detail
from srprov.record.memory import Memory
from srprov.resource import Observed
from tests import worlds
from tests.bounded import within
from tests.fakes import Behaviour, World
from tests.worlds import CHECK, apply, experiment, fleet, plan_for, run, service


def seen(world: World, instance: str = "hello", what: Experiment | None = None, *, ran: bool = False) -> Status:
    """Return the status of an instance on a world."""
    with worlds.remembering_all(world):
        return status_of(fleet(world).gather(Detail.BASIC), instance, what, lambda _: ran)


def problems(status: Status) -> dict[tuple[str, str], str]:
    """Return service and robot -> problem, of the rows that have one."""
    return {(row["service"], row["robot"]): row["problem"] for row in status.services if row["problem"]}


def two() -> Experiment:
    """Return two services on a robot each."""
    return experiment(service("a", robot="r1"), service("b", robot="r2"))


def test_all_is_well_after_an_apply() -> None:
    """No problem, with the EDF and without it."""
    w = World().add("r1", "r2")
    apply(w, two())
    for status in (seen(w), seen(w, what=two()), seen(w, "")):
        assert [row["service"] for row in status.services] == ["a", "b"]
        assert status.as_it_should_be


def test_a_service_whose_container_is_gone_is_missing() -> None:
    """The record knows that it should be there, and where; also when no instance is named."""
    w = World().add("r1", "r2")
    apply(w, two())
    address = seen(w).services[1]["address"]
    w.robots["r2"].engine.containers.clear()
    for status in (seen(w), seen(w, what=two()), seen(w, "")):
        assert problems(status) == {("b", "r2"): "missing"}
        row = status.services[1]
        assert (row["state"], row["placed_on"], row["given_address"]) == ("missing", "r2", address)
        assert not status.as_it_should_be


def test_a_service_that_was_never_placed_is_missing_by_the_edf() -> None:
    """Only the EDF can know of it; what it does not have any more is unwanted."""
    w = World().add("r1", "r2")
    apply(w, two())
    status = seen(w, what=experiment(service("a", robot="r1"), service("c")))
    assert problems(status) == {("b", "r2"): "unwanted", ("c", ""): "missing"}
    assert problems(seen(w)) == {}


def test_a_service_with_a_profile_is_missing_only_where_it_was_placed() -> None:
    """Nobody may have wanted it; once somebody has, its container should be there."""
    world = World().add("r1")
    what = experiment(service("a"), service("b", profiles=("debug",)))
    apply(world, experiment(service("a")))
    assert problems(seen(world, what=what)) == {}
    apply(world, what)
    del world.robots["r1"].engine.containers["srprov.hello.b"]
    assert problems(seen(world, what=what)) == {("b", "r1"): "missing"}


def test_what_only_trials_have_is_not_missing_while_none_is_under_way() -> None:
    """`run` makes these containers and removes them; what it keeps, what `apply` brought up, is looked at as ever."""
    w = World().add("r1", "r2")
    given = TrialDefinitions(settings=TrialSettings(keep=("camera",)))
    services = (service("a", robot="r1"), service("b", robot="r2"), service("camera", robot="r1"))
    what = experiment(*services, trials=given)
    before = seen(w, what=what)
    assert problems(before) == {("camera", ""): "missing"}
    assert before.trials.startswith("hello has trials, and none is under way: `srprov run`")
    apply(w, what)
    assert seen(w, what=what).as_it_should_be and seen(w, what=what).trials == ""
    w.robots["r2"].engine.containers.clear()
    assert problems(seen(w, what=what)) == {("b", "r2"): "missing"}, "it was applied"
    for name in [name for name in w.robots["r1"].engine.containers if not name.endswith("camera")]:
        del w.robots["r1"].engine.containers[name]
    over = seen(w, what=what)
    assert [row["service"] for row in over.services] == ["camera"], "so a run leaves it"
    assert over.as_it_should_be and over.trials


def test_without_an_edf_the_last_record_says_that_only_trials_had_them() -> None:
    w = World().add("r1", "r2")
    apply(w, two())
    assert seen(w, ran=True).as_it_should_be and not seen(w, ran=True).trials
    w.robots["r2"].engine.containers.clear()
    assert problems(seen(w, ran=True)) == {("b", "r2"): "missing"}, "one is there, so it was applied"
    w.robots["r1"].engine.containers.clear()
    over = seen(w, ran=True)
    assert over.services == [] and over.trials.startswith("hello has trials")
    assert problems(seen(w)) == {("a", "r1"): "missing", ("b", "r2"): "missing"}


def test_results_alone_are_no_trials() -> None:
    """`collect` brings them home of what `apply` brought up: without containers, these are missing."""
    what = experiment(service("a", robot="r1"), trials=TrialDefinitions(results={"a": ()}))
    status = seen(World().add("r1"), what=what)
    assert (problems(status), status.trials) == ({("a", ""): "missing"}, "")


def test_a_rebooted_robot_lacks_its_link() -> None:
    """Docker starts the container again, and nobody the VXLAN link: it runs, and reaches no other robot."""
    w = World().add("r1", "r2")
    apply(w, two())
    kernel = w.robots["r2"].kernel
    for name in [name for name, link in kernel.links.items() if link.kind == "vxlan"]:
        del kernel.links[name]
    status = seen(w)
    assert problems(status) == {}
    (link,) = status.links
    assert (link["robot"], link["kind"], link["problem"]) == ("r2", "vxlan", "missing")
    assert not status.as_it_should_be


def test_rules_that_are_gone_are_named() -> None:
    """Without them any host may send into the overlay, as after a firewall was reloaded."""
    w = World().add("r1", "r2")
    apply(w, two())
    (name,) = w.robots["r1"].kernel.filters
    del w.robots["r1"].kernel.filters[name]
    w.robots["r2"].kernel.filters[name].pop()
    links = [(one["robot"], one["kind"], one["problem"]) for one in seen(w).links]
    assert links == [("r1", "vxlan_filter", "missing"), ("r2", "vxlan_filter", "incomplete")]
    w.robots["r1"].kernel.filters[name] = [f"table bridge {name} {{", "}"]
    assert [(one["robot"], one["problem"]) for one in seen(w).links] == [("r1", "missing"), ("r2", "incomplete")]


def test_a_link_that_is_down_or_joined_to_nothing_is_named() -> None:
    """Both cut its services off, as a missing one does."""
    w = World().add("r1", "r2")
    apply(w, two())
    for robot, field, value in (("r1", "up", False), ("r2", "master", "")):
        (link,) = (link for link in w.robots[robot].kernel.links.values() if link.kind == "vxlan")
        setattr(link, field, value)
    assert [(one["robot"], one["problem"]) for one in seen(w).links] == [("r1", "down"), ("r2", "detached")]


def test_a_robots_network_that_is_gone_is_named() -> None:
    """The engine lost it, with its bridge."""
    w = World().add("r1", "r2")
    apply(w, two())
    w.robots["r1"].engine.networks.clear()
    assert [(one["robot"], one["kind"]) for one in seen(w).links] == [("r1", "network")]


def test_how_a_process_is_wrong_is_told() -> None:
    """A job that ended well is fine where the EDF says that it is one, or where nobody says anything."""
    w = World().add("r1")
    states = {"stopped": "exited", "paused": "paused", "again": "restarting", "sick": "running", "job": "exited"}
    what = experiment(*(service(name, **({"healthcheck": CHECK} if name == "sick" else {})) for name in states))
    w.robots["r1"].engine.behaviours["sick"] = Behaviour(healthy_after=-1)
    apply(w, what)
    for container in w.robots["r1"].engine.containers.values():
        container.state = states[container.service]
        container.code = 137 if container.service == "stopped" else 0
    expected = {"stopped": "stopped", "paused": "paused", "again": "restarting", "sick": "unhealthy"}
    assert problems(seen(w)) == {(name, "r1"): problem for name, problem in expected.items()}
    assert problems(seen(w, what=what))[("job", "r1")] == "stopped"
    jobs = experiment(*(service(name, job=name == "job") for name in states))
    assert ("job", "r1") not in problems(seen(w, what=jobs))


def test_a_copy_on_a_robot_that_came_back_is_a_duplicate() -> None:
    """The record tells which of the two is the one that other robots reach."""
    w = World().add("r1", "r2", "r3")
    what = experiment(service("a"), service("b"))
    apply(w, what)
    homes = {row["service"]: row["robot"] for row in seen(w).services}
    old = homes["a"]
    w.robots[old].gone = True
    assert problems(seen(w))[("a", old)] == "unreachable"
    moved = plan_for(w, what, reassign_unreachable=True)
    run(w, moved)
    w.robots[old].gone = False
    rows = {(row["robot"], row["problem"], row["placed_on"]) for row in seen(w).services if row["service"] == "a"}
    home = moved.assignment["a"]
    assert home != old
    assert rows == {(home, "", home), (old, "duplicate", home)}


def test_a_container_with_another_address_than_peers_have_is_named() -> None:
    """Peers' hosts files and forwarding tables are made from the record."""
    w = World().add("r1", "r2")
    apply(w, two())
    (container,) = w.robots["r2"].engine.containers.values()
    ends: dict[str, Any] = container.body["NetworkingConfig"]["EndpointsConfig"]
    next(iter(ends.values()))["IPAMConfig"]["IPv4Address"] = "10.1.2.3"
    assert problems(seen(w)) == {("b", "r2"): "address"}


def test_a_thousand_instances_on_each_of_a_dozen_robots_are_told_in_time() -> None:
    """A robot may name so many; each was looked for among the containers of all."""
    robots = [f"r{number}" for number in range(12)]
    there = {
        robot: tuple(
            Observed(
                module="container", name=f"srprov.i{number}{robot}.a", instance=f"i{number}{robot}",
                state={"service": "a", "state": "running", "health": "", "addresses": {}},
            )
            for number in range(1000)
        )
        for robot in robots
    }  # fmt: skip
    known = fleet(World().add(*robots)).gather(Detail.BASIC)
    with within(2):
        status = status_of(replace(known, observed=there))
        assert len(status.services) == 12_000


def forge(world: World, liar: str, without: str) -> None:
    """Let a robot hold a record of the highest serial that lacks a service and its robot."""
    path = "/var/lib/srprov/hello/placement.json"
    said = json.loads(world.robots[liar].disk.files[path])
    del said["robots"][said["services"].pop(without)["robot"]]
    world.robots[liar].disk.files[path] = json.dumps({**said, "serial": 10**9}).encode()


def test_a_robot_that_leaves_another_out_hides_nothing() -> None:
    """Neither where this machine wrote the record nor where it remembers nothing, nor when no instance is named."""
    w = World().add("r1", "r2", "r3")
    apply(w, two())
    with worlds.remembering_all(w):
        ours = ownership.recall("hello")
    w.robots["r2"].engine.containers.clear()
    forge(w, "r1", without="b")
    for memory in (ours, Memory()):
        for name in ("hello", ""):
            with mock.patch.object(ownership, "recall", lambda _name, kept=memory: kept):
                status = status_of(fleet(w).gather(Detail.BASIC), name)
            assert problems(status) == {("b", "r2"): "missing"} and not status.as_it_should_be
            (said,) = (*status.disputes, *status.notes)
            assert "r1" in said and "hello" in said
            assert bool(status.disputes) is (memory == Memory()) and ("r2" in said) is (memory == Memory())


def test_the_log_of_a_decoy_is_not_labelled_as_the_service() -> None:
    """Whatever name a container carries, and whatever the record of its robot says."""
    w = World().add("r1", "r2", "r3")
    apply(w, two())
    with worlds.remembering_all(w):
        ours = ownership.recall("hello")
    (real,) = w.robots["r2"].engine.containers.values()
    w.robots["r1"].engine.containers["decoy"] = real
    path = "/var/lib/srprov/hello/placement.json"
    said = json.loads(w.robots["r1"].disk.files[path])
    said["services"]["b"]["robot"], said["serial"] = "r1", 10**9
    w.robots["r1"].disk.files[path] = json.dumps(said).encode()
    snapshot = fleet(w).gather(Detail.BASIC)
    with mock.patch.object(ownership, "recall", return_value=ours):
        assert {one[:2] for one in containers_of(snapshot, "hello", ["b"])} == {("b@r1", "r1"), ("b", "r2")}
    with mock.patch.object(ownership, "recall", return_value=Memory()):
        assert {one[0] for one in containers_of(snapshot, "hello", [])} == {"a@r1", "b@r1", "b@r2"}


def test_nothing_is_missing_where_no_robot_answers() -> None:
    """What should be there may well run: nobody looked."""
    w = World().add("r1", "r2")
    apply(w, two())
    for robot in w.robots.values():
        robot.gone = True
    status = seen(w, what=two())
    assert problems(status) == {("a", ""): "unreachable", ("b", ""): "unreachable"}
    assert [row["state"] for row in status.services] == ["not known", "not known"]
