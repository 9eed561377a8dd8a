"""`network: both`: on the robot's own network, with an address on the overlay; from the plan to the status."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.authority import check_file
from srprov.controller.saved import check_plan
from srprov.definitions.model import Experiment
from srprov.errors import UsageError
from srprov.planning.plan import Step
from srprov.planning.planfile import dump
from srprov.planning.planread import load
from srprov.planning.steps import due_step
from tests.fakes import World
from tests.unit.controller.test_saved import planned, reread
from tests.unit.controller.test_status import problems, seen
from tests.worlds import apply, experiment, fleet, plan_for, run, service


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def two(mode: str = "both") -> Experiment:
    """Return a service on its robot's network and one on the overlay."""
    return experiment(service("a", robot="r1", network=mode), service("b", robot="r2"))


def test_its_address_is_on_the_bridge_and_what_drifts_is_mended_without_touching_the_container() -> None:
    """`status` names it, the plan has one step for it, and after that all is well."""
    world = World().add("r1", "r2")
    apply(world, two())
    address = seen(world).services[0]["address"]
    links = world.robots["r1"].kernel.links.values()
    (bridge,) = (link for link in links if link.kind == "bridge")
    assert bridge.services == {address} and seen(world).as_it_should_be
    assert ("00:00:00:00:00:00", bridge.mac) == tuple(sorted(mac for _, mac, _ in world.robots["r2"].kernel.fdb))
    bridge.services = frozenset({"10.9.9.9"})
    assert problems(seen(world)) == {("a", "r1"): "address"}
    (step,) = plan_for(world, two()).steps
    assert (step.module, step.change.cause) == ("vxlan", "addresses of services: 1 to add, 1 to remove")
    apply(world, two())
    assert bridge.services == {address} and problems(seen(world)) == {}


def test_changing_host_to_both_restarts_no_container() -> None:
    """To the engine both are the host's network."""
    world = World().add("r1", "r2")
    apply(world, two("host"))
    assert {step.module for step in plan_for(world, two()).steps} == {"network", "vxlan", "vxlan_filter", "file"}
    apply(world, two())
    assert seen(world).as_it_should_be


def test_a_plan_file_with_it_is_applied() -> None:
    """The record of the placement in it is the one of its own containers."""
    world = World().add("r1", "r2")
    saved = reread(planned(world, two()))
    assert {one.kind for one in saved.plan.permissions} == {"host-network"}
    assert run(world, check_plan(saved, fleet(world), adopt=True).plan).exit_code == 0
    assert planned(world, two()).plan.empty


@pytest.mark.parametrize("address", ["192.0.2.1", "10.0.0.1", "gateway"])
def test_a_plan_file_puts_no_other_address_on_a_robots_bridge(address: str) -> None:
    """What does not belong to the overlay's services would draw the robot's own packets to itself."""
    world = World().add("r1", "r2")
    saved = reread(planned(world, two()))
    network = next(step.want for step in saved.plan.steps if step.module == "network" and step.host == "r1")
    assert network is not None
    forged = network.params.gateway if address == "gateway" else address

    def with_address(step: Step) -> Step:
        want = step.want
        if want is None or (want.module, want.host) != ("vxlan", "r1"):
            return step
        params = replace(want.params, addresses=(forged,))
        want = replace(want, params=params, written={**want.written, "addresses": [forged]})
        due = due_step(want, None)
        assert due is not None
        return replace(step, want=want, change=due.change)

    plan = replace(saved.plan, steps=tuple(with_address(step) for step in saved.plan.steps))
    changed = replace(saved, plan=plan, proof="")
    with pytest.raises(UsageError, match="its addresses are not such as services on the network there may have"):
        check_file(load(dump(changed), "plan.json"), "plan.json")
