"""Plans that somebody else wrote, and that say of a robot which does not answer, or is not asked, what is not so."""

from __future__ import annotations

import copy
from typing import Any
from unittest import mock

import pytest
from msgspec.structs import replace

from srprov.controller import plan as planning
from srprov.controller import services
from srprov.controller.authority import asked, check_file, wants_of
from srprov.controller.owners import owners_folder
from srprov.controller.saved import check_plan, kept_plan, plan_file
from srprov.errors import RefusedError, UsageError
from srprov.modules.network import NetworkParams
from srprov.modules.params import ParameterError
from srprov.network import layout
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.record.memory import Memory, remember
from tests.fakes import FakeRobot, World
from tests.unit.controller.test_saved import _alone, planned
from tests.worlds import apply, experiment, fleet, run, service

__all__ = ["_alone"]

MINE = experiment(service("one", robot="r1"), service("two", robot="r2"))
NEW = experiment(
    *(service(name, robot=robot) for name, robot in (("one", "r1"), ("two", "r2"), ("three", "r3"))), name="new"
)
ANOTHERS = "10.0.0.4"
"""The underlay address of r4."""


@pytest.fixture
def world() -> World:
    """Return four robots, two of which run an experiment of the user's."""
    world = World().add("r1", "r2", "r3", "r4")
    assert apply(world, MINE).exit_code == 0
    return world


def written(saved: PlanFile) -> PlanFile:
    """Return a plan file as somebody who knows the format writes it."""
    saved = replace(saved, proof="", plan=replace(saved.plan, notes=(), permissions=()))
    saved = replace(saved, plan=replace(saved.plan, permissions=asked(saved)))
    saved = load(dump(saved), "plan.json")
    check_file(saved, "plan.json")
    return saved


def test_no_packets_go_to_another_robots_address_for_one_that_is_away(world: World) -> None:
    """The file said that r1 is where r4 is; r1 does not answer, so nobody contradicts: r4 was sent what is for r1."""
    true = layout._underlays
    with mock.patch.object(layout, "_underlays", lambda *given: {**true(*given), "r1": ANOTHERS}):
        saved = kept_plan(planned(world, NEW))
    prints = {robot: copy.deepcopy(dict(one)) for robot, one in saved.fingerprints.items()}
    prints["r1"]["underlay"]["address"] = ANOTHERS
    saved = written(replace(saved, fingerprints=prints))
    world.robots["r1"].gone = True
    with pytest.raises(RefusedError, match=rf"packets would go to {ANOTHERS} for r1, of which only this file says"):
        check_plan(saved, fleet(world), adopt=True)


@pytest.mark.parametrize("lie", [ANOTHERS, "", "10.0.0.9"])
def test_a_record_has_each_robot_where_the_plan_found_it(world: World, lie: str) -> None:
    """The user's next plan sends there what is for r1, when that does not answer."""
    true = planning.record

    def lying(*args: Any, **more: Any) -> dict[str, Any]:
        said = copy.deepcopy(true(*args, **more))
        said["robots"]["r1"]["vtep"] = lie
        return said

    theirs = experiment(*MINE.services.values(), service("four", robot="r4"))
    with mock.patch.object(planning, "record", lying):
        saved = replace(kept_plan(planned(world, theirs)), proof="")
    assert "playbook" in {one.kind for one in asked(saved)}
    with pytest.raises(UsageError, match="asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, permissions=())), "plan.json")


def test_packets_go_to_no_robot_that_does_not_answer(world: World) -> None:
    """Its address is only what the file says; the robot may be anywhere."""
    saved = replace(kept_plan(planned(world, NEW)), proof="")
    check_plan(saved, fleet(world), adopt=True)
    world.robots["r3"].gone = True
    with pytest.raises(RefusedError, match=r"packets would go to 10\.0\.0\.3 for r3"):
        check_plan(saved, fleet(world), adopt=True)


@pytest.mark.parametrize("there", ["robots", "one that the plan is not about", "memory"])
def test_no_instance_that_is_there_is_changed(world: World, there: str) -> None:
    """Of one, a file leaves out, or gives away, what nobody sees in what it shows: who runs where, who has an address.

    The controller's own plan is done, and one that is signed.
    """
    away: dict[str, FakeRobot] = {}
    if there != "robots":  # no robot of the plan has a record of it
        world = World().add("r1", "r2")
        apply(world, MINE)
        away, world.robots = world.robots, {}
        world.add("r3", address="10.0.0.3").add("r4", address="10.0.0.4")
    what = experiment(service("one", robot="r4"), service("two", robot="r3")) if away else MINE
    with mock.patch("srprov.controller.plan.source_of", return_value="lab@desk:/e/hello.edf"):
        saved = kept_plan(planned(world, what))
    check_plan(saved, fleet(world))
    world.robots |= away
    if there == "memory":
        remember("hello", Memory(robots=frozenset(away)))
        world.robots["r1"].gone = world.robots["r2"].gone = True
    for proof in ("", "0" * 40):
        for trust in ({}, {"adopt": True}):
            forged = replace(saved, proof=proof)
            with pytest.raises(RefusedError, match=r"not written on this controller, and would change .* r1, r2"):
                check_plan(forged, fleet(world), **trust)
    if there == "robots":
        check_plan(replace(saved, proof=""), fleet(world), signed=True)
        for twin in owners_folder().iterdir():
            twin.unlink()
        with pytest.raises(RefusedError, match=r"not written on this controller, and would change .* on r1, r2"):
            check_plan(saved, fleet(world))


def test_a_new_instance_is_made_whole_and_only_with_adopt(world: World) -> None:
    saved = replace(kept_plan(planned(world, NEW)), proof="")
    with pytest.raises(RefusedError, match="would make instance 'new'") as told:
        check_plan(saved, fleet(world))
    assert "--adopt" in told.value.hint
    limited = replace(kept_plan(planned(world, NEW).limited(["r1"])), proof="")
    for some in (limited, replace(limited, limit=(), targets=("of-r1",))):
        with pytest.raises((RefusedError, UsageError)) as refused:
            check_plan(some, fleet(world), adopt=True)
        assert some is not limited or "only some of the steps that follow" in refused.value.message
    silent = replace(limited, plan=replace(limited.plan, notes=(), unchanged=7777))
    signed = check_plan(silent, fleet(world), signed=True).plan
    assert any("left out by --limit or --exclude" in note for note in signed.notes) and signed.unchanged < 100


@pytest.mark.parametrize("lie", ["a robot that is nowhere", "words without end"])
def test_a_new_instance_has_nothing_on_robots_that_the_plan_does_not_know(world: World, lie: str) -> None:
    """Its record could say anything of them, at any length: the records of other instances were read no more."""
    true = planning.record

    def lying(*args: Any, **more: Any) -> dict[str, Any]:
        said = copy.deepcopy(true(*args, **more))
        ip = "" if lie.startswith("a robot") else "x" * 1_000_001
        said["services"]["away"] = {"ip": ip, "mac": "", "network": "overlay", "robot": "r9"}
        said["robots"]["r9"] = {"gateway": "", "vtep": None}
        return said

    with mock.patch.object(planning, "record", lying):
        saved = kept_plan(planned(world, NEW))
    plan = replace(saved.plan, assignment={**saved.plan.assignment, "away": "r9"}, unreachable={"r9": "no answer"})
    saved = replace(saved, plan=plan, proof="")
    assert "playbook" in {one.kind for one in asked(saved)}
    with pytest.raises(RefusedError, match="robots that it knows nothing of: r9"):
        check_plan(saved, fleet(world), adopt=True)


@pytest.mark.parametrize("name", ["busybox@latest", "busybox::latest", "docker.io/library/busybox:latest", "busybox"])
def test_an_image_has_one_name(world: World, name: str) -> None:
    """An engine takes other spellings, and gives the image that one: the tag of what the user has built, too."""
    saved = kept_plan(planned(world, NEW))
    steps = [replace(one, name=name, want=replace(one.want, name=name)) if one.want and one.module == "image" else one
             for one in saved.plan.steps]  # fmt: skip
    wants = [replace(one, name=name) if one.module == "image" else one for one in saved.also_wanted]
    changed = replace(saved, plan=replace(saved.plan, steps=tuple(steps)), also_wanted=tuple(wants))
    with pytest.raises(UsageError, match="no image is called that"):
        check_file(changed, "plan.json")


@pytest.mark.parametrize("gateway", ["::ffff:10.1.0.9", "", "10.1.0.029", "10.1.0.0", "10.1.15.255", "10.2.0.1"])
def test_a_bridge_has_an_address_of_its_network(gateway: str) -> None:
    """An engine takes other spellings, and the bridge that of another robot's service."""
    with pytest.raises(ParameterError, match="gateway"):
        NetworkParams(
            instance="x", source="s", bridge="b", subnet="10.1.0.0/20", gateway=gateway, mtu=1450, vni=1, port=1
        )


def test_what_containers_are_said_to_have_of_the_controller_is_asked_for(world: World) -> None:
    """A later plan, and records, hide what stands there."""
    with mock.patch.object(services, "_taken", lambda *_: ["*", "LD_PRELOAD"]):
        saved = replace(kept_plan(planned(world, NEW)), proof="")
    assert {"env", "outside"} <= {one.kind for one in asked(saved)}
    with pytest.raises(UsageError, match="asks for env"):
        check_file(replace(saved, plan=replace(saved.plan, permissions=())), "plan.json")


def test_robots_that_a_file_calls_away_are_asked(world: World) -> None:
    """Those that answer are not; of one that does not, it is told that it may have some of the instance."""
    saved = replace(kept_plan(planned(world, NEW)), proof="")
    away = replace(saved, plan=replace(saved.plan, unreachable={"r2": "no answer", "r4": "no answer"}))
    world.add("r5")
    world.robots["r4"].gone = world.robots["r5"].gone = True
    plan = check_plan(away, fleet(world), adopt=True).plan
    assert set(plan.unreachable) == {"r4"}
    assert "robots that do not answer may have something of its instance: r5" in plan.notes


def test_a_robot_that_is_away_gets_nothing_where_another_one_has_its_address(world: World) -> None:
    """Whoever has the address by then would be sent what is for its services."""
    world.robots["r1"].gone = True
    world.robots["r4"].kernel.address = "10.0.0.1"
    one = planned(world, MINE)
    assert any("r4 has the address 10.0.0.1 that it had: nothing is sent to it" in note for note in one.plan.notes)
    assert run(world, one.plan).exit_code == 4
    kernel = world.robots["r2"].kernel
    assert "10.0.0.1" not in str(kernel.fdb) and "10.0.0.1" not in str(kernel.filters)


def test_a_robot_is_at_an_address_in_the_record_of_a_plan_file(world: World) -> None:
    """It was any text that the file itself said twice, 3 MB of it: then no record on the robots was read any more."""
    long, true = "x" * 3_000_000, planning.record

    def lying(*args: Any, **more: Any) -> dict[str, Any]:
        said = copy.deepcopy(true(*args, **more))
        said["robots"]["r1"]["vtep"] = long
        return said

    alone = experiment(*(service(name, robot=name, network="none") for name in ("r1", "r2")), name="new")
    with mock.patch.object(planning, "record", lying), mock.patch.object(planning, "check_room"):
        saved = kept_plan(planned(world, alone))
    prints = {robot: copy.deepcopy(dict(one)) for robot, one in saved.fingerprints.items()}
    prints["r1"]["underlay"]["address"] = long
    saved = replace(saved, fingerprints=prints, proof="")
    assert "playbook" in {one.kind for one in asked(saved)}
    with pytest.raises(UsageError, match="asks for playbook"):
        check_file(replace(saved, plan=replace(saved.plan, permissions=())), "plan.json")


def test_a_plan_file_that_has_a_robot_have_two_networks_is_refused_first(world: World) -> None:
    """All links are compared with all networks: 8000 of both took 38 s."""
    saved = kept_plan(planned(world, NEW))
    network = next(one for one in wants_of(saved) if one.module == "network")
    with pytest.raises(UsageError, match="has once for each robot: a network") as wrong:
        check_file(replace(saved, also_wanted=(*saved.also_wanted, network), fingerprints={}), "plan.json")
    assert "fingerprints" not in str(wrong.value)


@pytest.mark.parametrize("length", [5000, 5001])
def test_a_plan_file_s_source_has_a_length(world: World, length: int) -> None:
    """It is in each record, and a label of each container and volume."""
    with mock.patch.object(planning, "source_of", return_value="x" * length):
        text = dump(plan_file(planned(world, NEW)))
    if length == 5000:
        load(text, "plan.json")
        return
    with pytest.raises(UsageError, match="its source is longer than 5000 characters"):
        load(text, "plan.json")


def test_a_record_names_robots_with_long_names(world: World) -> None:
    """A robot's name has up to 200 characters, and no record of one is taken for somebody's own file."""
    world.add(long := "r" * 200)
    saved = plan_file(planned(world, experiment(service("one", robot=long), service("two", robot="r2"), name="new")))
    assert saved.plan.permissions == ()


@pytest.mark.parametrize("lie", ["assignment", "record"])
def test_nothing_runs_where_a_robot_answers_and_nothing_is_wanted(world: World, lie: str) -> None:
    """The file itself called r3 out of reach: a service was shown there, recorded on all robots, and never made."""
    true = planning.record

    def lying(*args: Any, **more: Any) -> dict[str, Any]:
        said = copy.deepcopy(true(*args, **more))
        if lie == "assignment":
            said["services"]["ghost"] = {"ip": "", "mac": "", "network": "none", "robot": "r3"}
            said["robots"]["r3"] = {"gateway": "", "vtep": "10.0.0.3"}
        else:
            said["robots"]["r2"]["gateway"] = "10.0.0.9"
        return said

    alone = experiment(*(service(name, robot=name, network="none") for name in ("r1", "r2")), name="new")
    with mock.patch.object(planning, "record", lying):
        saved = plan_file(planned(world, alone))
    ghost = {"ghost": "r3"} if lie == "assignment" else {}
    away = {"r3": "no answer"} if ghost else {"r2": "no answer"}
    saved = written(
        replace(saved, plan=replace(saved.plan, assignment={**saved.plan.assignment, **ghost}, unreachable=away))
    )
    assert saved.plan.permissions == ()
    who, says = next(iter(away)), "'ghost' is said to run on r3, and nothing of it is wanted there" if ghost else "asks"
    with pytest.raises(UsageError, match=rf"this plan, while {who} answers, contradicts itself:(?s:.*){says}"):
        check_plan(saved, fleet(world), adopt=True)
    check_plan(saved, fleet(world), signed=True)
