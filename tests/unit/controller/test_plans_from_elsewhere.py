"""What a plan file that was not written here is refused: what lies on robots already, and builds by whom it names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller.image_builders import check_builders
from srprov.controller.owners import read_owner
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, plan_file
from srprov.definitions.model import Definitions, Host, Inventory
from srprov.definitions.secretmodel import SecretSource, SecretUse
from srprov.errors import RefusedError
from srprov.facts.model import Docker, HostFacts, Snapshot
from srprov.modules.image import ImageParams
from srprov.planning.planfile import PlanFile
from srprov.record.memory import Memory, remember
from srprov.resource import Observed, Resource
from srprov.secret import Secret, Vault
from tests.fakes import World
from tests.worlds import Experiment, experiment, fleet, made, run, service

TAG = "srprov/cam:0123456789abcdef0123456789abcdef"


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def with_secret(variable: str) -> Experiment:
    use = SecretUse(source="token", target="/run/secrets/token")
    secrets = {"token": SecretSource(name="token", env=variable)}
    return experiment(service("x", robot="r1", network="none", secrets=(use,)), name="fleet", secrets=secrets)


def after_a_failed_run(value: str) -> World:
    """Return a robot on which a run has written a secret, and then failed."""
    world = World().add("r1")
    world.vault = Vault({"token": Secret(value)})
    plan = planned(world, with_secret("OURS"), value).plan
    steps = tuple(replace(one, needs=()) for one in plan.steps if one.module != "container")
    assert run(world, replace(plan, steps=steps)).exit_code == 0
    return world


def planned(world: World, what: Experiment, value: str, source: str = "lab@desk:/e/fleet.edf") -> PlanFile:
    request = PlanRequest(exact=True, adopt=True, allowed=frozenset({"secret"}), owner=read_owner(what.name, what.file))
    with mock.patch("srprov.controller.plan.source_of", return_value=source):
        return plan_file(
            made(world, Definitions(experiment=what, containers={}), request, Vault({"token": Secret(value)}))
        )


@pytest.mark.parametrize(
    ("source", "adopt", "why"),
    [
        ("lab@desk:/e/fleet.edf", False, "not written on this controller"),
        ("x@y:/z", False, "was made from"),
        ("x@y:/z", True, "would change instance 'fleet', which is there on r1"),
    ],
)
def test_a_secret_that_a_failed_run_left_is_given_to_no_plan_from_elsewhere(source: str, adopt: bool, why: str) -> None:
    """It says that its secret is right already, and comes from another variable: its container had the user's."""
    world = after_a_failed_run("value-of-the-user")
    saved = planned(world, with_secret("HARMLESS"), "value-of-the-user", source)
    assert any(one.module == "secret" for one in saved.also_wanted)
    with pytest.raises(RefusedError, match=why):
        check_plan(saved, fleet(world), adopt=adopt)
    check_plan(saved, fleet(world), adopt=True, signed=True)


def test_a_plan_from_elsewhere_places_no_service_of_an_instance_that_this_machine_has_put_on_other_robots() -> None:
    """Root on `r1` removed what it had of it; the plan's record was the newest, and `cp` sent a file to `r1`."""
    world = World().add("r1")
    saved = planned(world, experiment(service("x", robot="r1", network="none"), name="fleet"), "value-of-a-test")
    with pytest.raises(RefusedError, match=r"would make instance 'fleet'$"):
        check_plan(saved, fleet(world))
    assert not remember("fleet", Memory(robots=frozenset({"r2"}), records=("0",)))
    with pytest.raises(RefusedError, match="would change instance 'fleet', put on r2 from here"):
        check_plan(saved, fleet(world))
    check_plan(saved, fleet(world), signed=True)


def robots(archs: Mapping[str, str], have: tuple[str, ...] = (), away: tuple[str, ...] = ()) -> Snapshot:
    docker = Docker(version="28", api_version="1.48")
    image = Observed(module="image", name=TAG, instance="", state={"id": "", "labels": {}})
    facts = {name: HostFacts(name=name, arch=arch, docker=docker) for name, arch in archs.items()}
    observed = {name: (image,) * (name in have) for name in archs}
    return Snapshot(facts=facts, observed=observed, unreachable=dict.fromkeys(away, ""))


def inventory(*names: str, builders: tuple[str, ...] = ()) -> Inventory:
    hosts = {name: Host(name=name, address=name) for name in names}
    return Inventory(hosts=hosts, groups={"builders": builders} if builders else {})


def wanted(robot: str, params: ImageParams) -> Resource:
    return Resource(host=robot, module="image", name=TAG, params=params, written={}, needs=(), source="")


def built(robot: str, *runs: str) -> Resource:
    return wanted(robot, ImageParams(source="build", blob=b"tar", runs=runs))


def copied(source: str, robot: str, id_: str = "") -> Resource:
    return wanted(robot, ImageParams(source="copy", from_=source, id=id_))


THREE = {"a": "amd64", "b": "amd64", "c": "amd64"}


def test_a_plan_from_elsewhere_has_images_built_by_who_builds_here() -> None:
    """Root on `b` gave all that it built the tag of the user's own image, which ran with what was allowed to that."""
    plain, named = inventory(*THREE), inventory(*THREE, builders=("a",))
    for here in (plain, named):
        check_builders([built("a"), copied("a", "b"), copied("a", "c")], here, robots(THREE))
        for wrong in ([built("b")], [copied("b", "c")], [built("a"), copied("c", "a")]):
            with pytest.raises(RefusedError, match=f"who builds: {TAG} on "):
                check_builders(wrong, here, robots(THREE))
    check_builders([copied("b", "c", "sha256:1")], named, robots(THREE))  # which `check_copies` looks at
    check_builders([built("b"), copied("b", "c")], inventory(*THREE, builders=("b", "c")), robots(THREE))


def test_who_builds_here_follows_from_robots_in_reach_and_what_they_have() -> None:
    check_builders([built("b")], inventory(*THREE), robots(THREE, have=("a",)))
    check_builders([built("b")], inventory(*THREE), robots({"b": "amd64", "c": "amd64"}, away=("a",)))
    check_builders([built("b")], inventory("a", "b"), robots({"a": "arm64", "b": "amd64"}))
    check_builders([built("gone")], inventory(*THREE), robots(THREE, away=("gone",)))  # nothing is done there
    # a file leaves out the robot that would build, or the group's
    for here in (inventory(*THREE), inventory(*THREE, builders=("a",))):
        with pytest.raises(RefusedError, match="who builds"):
            check_builders([built("b"), copied("b", "c")], here, robots({"b": "amd64", "c": "amd64"}))


def test_a_robot_that_says_to_be_of_an_architecture_of_its_own_builds_for_no_other() -> None:
    snapshot = robots({**THREE, "b": "riscv64"})
    check_builders([built("b", "riscv64")], inventory(*THREE), snapshot)
    for wrong in ([built("b", "riscv64"), copied("b", "c")], [built("b", "amd64")]):
        with pytest.raises(RefusedError, match="who builds"):
            check_builders(wrong, inventory(*THREE), snapshot)


def test_without_a_builder_in_reach_robots_of_a_plan_from_elsewhere_build_for_themselves_alone() -> None:
    named = inventory(*THREE, builders=("a",))
    for snapshot in (robots({"b": "amd64", "c": "amd64"}, away=("a",)), robots({**THREE, "a": "arm64"})):
        check_builders([built("b"), built("c")], named, snapshot)
        with pytest.raises(RefusedError, match=f"who builds: {TAG} on b$"):
            check_builders([built("b"), copied("b", "c")], named, snapshot)
    with pytest.raises(RefusedError, match="who builds"):  # it may be there, the file does not ask it
        check_builders([built("b")], named, robots({"b": "amd64"}))
