"""`network.discovery` from the plan to the containers: who is told of a new peer, and who is not disturbed by one."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.controller.saved import check_plan
from srprov.definitions.model import Experiment, NetworkSettings
from tests.fakes import World
from tests.unit.controller.test_saved import planned, reread
from tests.worlds import apply, experiment, fleet, plan_for, run, service

PEERS = NetworkSettings(discovery="static-peers")


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def some(*names: str, network: NetworkSettings = PEERS) -> Experiment:
    """Return services, one on each robot."""
    return experiment(*(service(name, robot=f"r{number}") for number, name in enumerate(names, 1)), network=network)


def test_a_new_peer_is_in_the_files_of_all_and_restarts_nobody() -> None:
    """The files keep their inodes, which running containers have mounted; only the new container has a step."""
    world = World().add("r1", "r2", "r3")
    apply(world, some("a", "b"))
    disk = world.robots["r1"].disk
    (path,) = [path for path in disk.files if path.endswith("/cyclonedds.xml")]
    inode, before = disk.inodes[path], disk.files[path].decode()
    plan = plan_for(world, some("a", "b", "c"))
    assert [step.name for step in plan.steps if step.module == "container"] == ["srprov.hello.c"]
    run(world, plan)
    assert disk.inodes[path] == inode and disk.files[path].decode().count("<Peer ") == before.count("<Peer ") + 1
    assert plan_for(world, some("a", "b", "c")).empty
    (new,) = world.robots["r3"].engine.containers.values()
    (peers,) = [one for one in new.body["Env"] if one.startswith("ROS_STATIC_PEERS=")]
    assert peers.count(";") == 2
    targets = {mount["Target"] for mount in new.body["HostConfig"]["Mounts"]}
    assert targets == {"/etc/hosts", "/etc/srprov/cyclonedds.xml", "/etc/srprov/fastdds.xml"}


def test_another_discovery_makes_containers_anew_and_takes_the_files_away() -> None:
    """The cause names what differs."""
    world = World().add("r1", "r2")
    apply(world, some("a", "b"))
    plan = plan_for(world, some("a", "b", network=NetworkSettings()))
    causes = {step.change.cause for step in plan.steps if step.module == "container"}
    assert causes == {"environment, kept variables, volumes differ"}
    run(world, plan)
    assert not [path for path in world.robots["r1"].disk.files if path.endswith(".xml")]


def test_a_plan_file_with_it_needs_no_permission() -> None:
    """Files and mounts are such as srprov itself states."""
    world = World().add("r1", "r2")
    saved = reread(planned(world, some("a", "b")))
    assert saved.plan.permissions == ()
    assert run(world, check_plan(saved, fleet(world), adopt=True).plan).exit_code == 0
    assert planned(world, some("a", "b")).plan.empty
