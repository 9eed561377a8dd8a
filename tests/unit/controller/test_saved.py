"""Plans that are kept in files: what is derived again when one is applied is what was planned."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.controller.authority import asked, check_file, wants_of
from srprov.controller.owners import Owner, keep, owners_folder, read_owner
from srprov.controller.plan import Planned
from srprov.controller.request import PlanRequest
from srprov.controller.saved import check_plan, kept_plan
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Definitions, NetworkSettings
from srprov.errors import RefusedError, StalePlan, UsageError
from srprov.planning.plan import Step
from srprov.planning.planfile import PlanFile, dump
from srprov.planning.planread import load
from srprov.resource import Action, Change, Need, Resource
from tests.fakes import World
from tests.resources import resource
from tests.worlds import Experiment, apply, experiment, fleet, made, run, service

FIRST = experiment(service("one", robot="r1"), service("two", robot="r2"), service("old", robot="r3"))
SECOND = experiment(
    service("one", robot="r1", command=("new",)),
    service("two", robot="r2", command=("new",), depends_on={"one": "started"}),
    service("three", robot="r3"),
)


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Owners' tokens are the user's: no test sees those of another."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.fixture
def world() -> World:
    """Return three robots on which the first experiment runs, and one that does nothing."""
    world = World().add("r1", "r2", "r3", "r4")
    assert apply(world, FIRST).exit_code == 0
    return world


def planned(world: World, what: Experiment = SECOND) -> Planned:
    request = PlanRequest(exact=True, adopt=True, owner=read_owner(what.name, what.file))
    whole = made(world, Definitions(experiment=what, containers={}), request)
    return replace(whole, definitions=None)


def reread(one: Planned) -> PlanFile:
    """Return the plan as it comes out of its file."""
    text = dump(kept_plan(one))
    saved = load(text, "plan.json")
    check_file(saved, "plan.json")
    assert dump(saved) == text
    return saved


def test_the_steps_are_those_that_were_planned(world: World) -> None:
    one = planned(world)
    again = check_plan(reread(one), fleet(world), adopt=True)
    assert [(step.id, step.number, step.needs, step.waits, step.change) for step in again.plan.steps] == [
        (step.id, step.number, step.needs, step.waits, step.change) for step in one.plan.steps
    ]
    assert run(world, again.plan).exit_code == 0
    assert planned(world).plan.empty


def test_a_robot_that_is_away_by_then_is_left_alone_and_the_others_are_done(world: World) -> None:
    saved = reread(planned(world))
    world.robots["r3"].gone = True
    checked = check_plan(saved, fleet(world), adopt=True)
    assert set(checked.plan.unreachable) == {"r3"}
    assert {step.host for step in checked.plan.steps if step.commands} == {"r1", "r2", "r4"}
    assert run(world, checked.plan).exit_code == 4
    assert ("two", "r2") in world.running() and ("old", "r3") in world.running()


@pytest.mark.parametrize("chosen", [["r1"], ["r2"], ["r1", "r3"]])
def test_a_plan_for_some_robots_is_done_on_these(world: World, chosen: list[str]) -> None:
    one = planned(world).limited(chosen)
    saved = reread(one)
    checked = check_plan(saved, fleet(world), adopt=True)
    assert [step.id for step in checked.plan.steps] == [step.id for step in one.plan.steps]
    assert {step.host for step in checked.plan.steps} <= set(chosen)
    assert run(world, checked.plan).exit_code == 0


def test_what_moved_is_told_as_such_also_where_no_step_is_about_it(world: World) -> None:
    """A file that was right, and a container that nobody wants: the plan is stale, not contradicted."""
    saved = reread(planned(world))
    container = next(one for one in world.robots["r2"].engine.containers.values() if one.service == "two")
    container.state, container.code = "exited", 1
    with pytest.raises(StalePlan, match=r"r2: resources container:srprov\.hello\.two"):
        check_plan(saved, fleet(world), adopt=True)


def test_an_instance_of_another_source_needs_adopt_again(world: World) -> None:
    saved = reread(planned(world))
    with pytest.raises(RefusedError, match="was made from"):
        check_plan(saved, fleet(world))


def test_steps_that_do_not_follow_are_named(world: World) -> None:
    saved = reread(planned(world))
    first = next(step for step in saved.plan.steps if step.want)
    steps = tuple(step for step in saved.plan.steps if step is not first)
    changed = replace(saved, plan=replace(saved.plan, steps=steps))
    with pytest.raises((UsageError, StalePlan)):
        check_plan(changed, fleet(world), adopt=True, signed=True)


def test_a_plan_from_elsewhere_does_not_say_who_made_a_volume(world: World) -> None:
    """Whoever read a plan, or looked on the robot, knows the label: the user's next apply would run what lies there."""
    mount = Mount(kind="volume", source="log", target="/l")
    saved = reread(planned(world, experiment(service("x", robot="r4", mounts=(mount,)), name="fleet")))
    check_plan(saved, fleet(world))
    for trust in ({}, {"adopt": True}, {"signed": True}):
        with pytest.raises(RefusedError, match=r"who made these volumes: srprov\.fleet\.log on r4"):
            check_plan(replace(saved, proof=""), fleet(world), **trust)
    for owner in owners_folder().iterdir():
        owner.unlink()
    with pytest.raises(RefusedError, match="who made these volumes"):
        check_plan(saved, fleet(world))  # of somebody else, whose next apply on these robots would run it
    check_plan(saved, fleet(world), signed=True)
    taken = next(want.params.owner for want in wants_of(saved) if want.module == "volume")
    keep(Owner(instance="fleet", edf="/e/y.edf", token="0123", adopted=frozenset({f"r4/srprov.fleet.log/{taken}"})))
    with pytest.raises(RefusedError, match="who made these volumes"):
        check_plan(saved, fleet(world), signed=True)


def test_a_plan_file_changes_no_overlay_of_an_instance_whose_links_have_the_same_names(world: World) -> None:
    """32 bits of a hash are found within minutes; a file that makes no network has its names looked at, too."""
    saved = reread(planned(world, experiment(service("x", robot="r4", network="none"), name="demo-1a3ftp20")))
    assert not any(want.module in ("network", "vxlan") for want in wants_of(saved))
    with pytest.raises(UsageError, match="belongs to 'hello', whose links would have the same names"):
        check_plan(saved, fleet(world))
    with pytest.raises(UsageError, match="belongs to 'hello'"):
        check_plan(replace(saved, proof=""), fleet(world), signed=True)


def test_a_step_of_a_kind_that_there_is_not_and_a_wait_that_cannot_end_are_refused_when_the_file_is_read(
    world: World,
) -> None:
    saved = reread(planned(world))

    def read(**changed: object) -> None:
        first = next(step for step in saved.plan.steps if step.module == "container")
        steps = tuple(replace(one, **changed) if one is first else one for one in saved.plan.steps)  # type: ignore[arg-type] # any field
        text = dump(replace(saved, plan=replace(saved.plan, steps=steps)))
        check_file(load(text, "plan.json"), "plan.json")

    read()
    with pytest.raises(UsageError, match="a kind that there is not: 'zzz'"):
        read(module="zzz", want=None)
    for wrong in ("", "xyz", "r1/zzz:q", "r1/file:/x", "/container:x", "r1/container:"):
        with pytest.raises(UsageError, match="nothing can wait for"):
            read(waits=(Need(wrong, "healthy"),))
    with pytest.raises(UsageError, match="the plan knows no such robot"):
        read(waits=(Need("nosuch/container:srprov.x.y", "healthy"),))


def test_a_unit_in_a_plan_file_asks_for_its_permission(world: World) -> None:
    """What restores a link is made of the link's parameters; a file that adds one contradicts its permissions."""
    saved = reread(planned(world))
    link = next(want for want in wants_of(saved) if want.module == "vxlan")
    written = {**link.written, "link": link.name}
    unit = resource("unit", f"srprov-{saved.plan.instance}.service", written, host=link.host)
    with pytest.raises(UsageError, match=r"network.persist asks for unit \(.*\), which is not among them"):
        check_file(replace(saved, also_wanted=(*saved.also_wanted, unit)), "plan.json")


@pytest.mark.parametrize("wrong", ["gone", "more", "other"])
def test_a_link_in_a_plan_file_without_its_own_filter_asks_for_a_permission(world: World, wrong: str) -> None:
    """Who takes a filter out of a file, or lets one more robot in, says so: srprov itself states no open overlay."""
    saved = reread(planned(world))
    closed = next(want for want in wants_of(saved) if want.module == "vxlan_filter" and want.host == "r1")
    written = dict(closed.written)
    if wrong == "more":
        written["peers"] = [*written["peers"], "192.0.2.99"]
    changed = {"gone": (), "more": (resource("vxlan_filter", closed.name, written, host="r1"),),
               "other": (resource("vxlan_filter", "srpv00000001", written, host="r1"),)}[wrong]  # fmt: skip
    also = tuple(one for one in saved.also_wanted if one != closed)
    steps = tuple(one for one in saved.plan.steps if one.want != closed)
    tampered = replace(saved, plan=replace(saved.plan, steps=steps), also_wanted=(*also, *changed))
    with pytest.raises(UsageError, match=r"r1/vxlan:srpv\w+ asks for playbook"):
        check_file(tampered, "plan.json")


def test_no_robot_is_let_into_an_overlay_where_no_service_of_it_runs(world: World) -> None:
    """Whoever is root there would be inside; and the plan told of two robots' links, and nothing of that one."""
    saved = reread(planned(world))
    other = saved.fingerprints["r1"]
    stranger = {**other, "underlay": {**other["underlay"], "address": "192.0.2.99"}}
    more = {"vxlan_filter": ("peers", "192.0.2.99"), "vxlan": ("fdb", ["00:00:00:00:00:00", "192.0.2.99"])}

    def opened(one: Resource) -> Resource:
        if one.module not in more:
            return one
        key, value = more[one.module]
        written = {**one.written, key: [*one.written[key], value]}
        return replace(resource(one.module, one.name, written, host=one.host), needs=one.needs)

    steps = tuple(replace(one, want=opened(one.want)) if one.want else one for one in saved.plan.steps)
    beside, prints = tuple(map(opened, saved.also_wanted)), {**saved.fingerprints, "r9": stranger}
    within = replace(saved, fingerprints=prints, plan=replace(saved.plan, steps=steps), also_wanted=beside)
    changed = {one.id for one in wants_of(within) if one.module in more}
    assert changed and changed & {step.id for step in steps}
    with pytest.raises(UsageError, match="asks for playbook"):
        check_file(within, "plan.json")
    placed = replace(within.plan, assignment={**saved.plan.assignment, "four": "r9"})
    said = {one.service for one in asked(replace(within, plan=placed))}
    links = {step.id for step in steps if step.module == "vxlan"}
    assert links and links <= said, "that one has no network of the plan"


def test_a_subnet_that_a_plan_from_elsewhere_chose_is_told() -> None:
    """What root on a robot reached there by its default route went to a container; its writer left out the note."""
    what = replace(FIRST, name="new", network=NetworkSettings(subnet="10.200.0.0/20"))
    world = World().add("r1", "r2", "r3")
    saved = reread(planned(world, what))
    assert "the overlay takes" not in str(check_plan(saved, fleet(world)).plan.notes), "written here"
    usual = reread(planned(world, replace(what, network=NetworkSettings())))
    shutil.rmtree(owners_folder())
    saved = replace(saved, plan=replace(saved.plan, notes=()))
    (note,) = (one for one in check_plan(saved, fleet(world), adopt=True).plan.notes if "the overlay takes" in one)
    assert note.startswith("the overlay takes 10.200.0.0/20 on r1, r2, r3, and not 10.") and "word of the plan" in note
    assert "the overlay takes" not in str(check_plan(usual, fleet(world), adopt=True).plan.notes)


@pytest.mark.parametrize("field", ["ip", "mac"])
def test_no_two_services_of_a_plan_file_have_one_address(world: World, field: str) -> None:
    """Who asks for the one would be answered by the other one, which may be nearer."""
    saved = reread(planned(world))
    first, second, *_ = (one for one in wants_of(saved) if one.module == "container")
    end = getattr(first.params.network, field)
    network = replace(second.params.network, **{field: end})
    changed = replace(second, params=replace(second.params, network=network))
    also = tuple(changed if one == second else one for one in saved.also_wanted)
    steps = tuple(replace(one, want=changed) if one.want == second else one for one in saved.plan.steps)
    with pytest.raises(UsageError, match=rf"{end}: \w+ and \w+ would both have it"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps), also_wanted=also), "plan.json")


def test_no_bridge_of_a_plan_file_has_the_address_of_a_service(world: World) -> None:
    """The robot itself would answer for it."""
    saved = reread(planned(world))
    end = next(one for one in wants_of(saved) if one.module == "container").params.network.ip
    bridge = next(one for one in wants_of(saved) if one.module == "network")
    changed = replace(bridge, params=replace(bridge.params, gateway=end))
    also = tuple(changed if one == bridge else one for one in saved.also_wanted)
    steps = tuple(replace(one, want=changed) if one.want == bridge else one for one in saved.plan.steps)
    with pytest.raises(UsageError, match=rf"{end}: \w+ and the bridge on r\d would both have it"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps), also_wanted=also), "plan.json")


def test_no_bridge_of_a_plan_file_has_the_address_of_a_service_beside_its_own(world: World) -> None:
    """It is for services in their robot's own network; of any other one the robot would answer for it."""
    saved = reread(planned(world))
    end = next(one for one in wants_of(saved) if one.module == "container").params.network.ip
    link = next(one for one in wants_of(saved) if one.module == "vxlan")
    changed = replace(link, params=replace(link.params, addresses=(end,)))
    also = tuple(changed if one == link else one for one in saved.also_wanted)
    steps = tuple(replace(one, want=changed) if one.want == link else one for one in saved.plan.steps)
    with pytest.raises(UsageError, match=rf"{end}: \w+ and the bridge on r\d would both have it"):
        check_file(replace(saved, plan=replace(saved.plan, steps=steps), also_wanted=also), "plan.json")


@pytest.mark.parametrize("target", ["/data/logs", "//data/x/../a/b", "/data//logs"])
def test_no_mount_of_a_plan_file_lies_below_what_another_service_writes_to(world: World, target: str) -> None:
    """No EDF says so: by a link in the volume that service would choose where the container has the mount."""
    below = (Mount(kind="volume", source="data", target="/data"), Mount(kind="tmpfs", source="", target=target))

    def saved(*others: Mount, robot: str = "r1") -> PlanFile:
        what = experiment(service("one", robot="r1", mounts=below), service("two", robot=robot, mounts=others))
        return load(dump(kept_plan(planned(world, what))), "plan.json")

    data = Mount(kind="volume", source="data", target="/d")
    with pytest.raises(UsageError, match=r"in the volume 'data', which 'r1/container:srprov.hello.two' may write to"):
        check_file(saved(data), "plan.json")
    for fine in (saved(replace(data, read_only=True)), saved(), saved(data, robot="r2")):
        check_file(fine, "plan.json")


@pytest.mark.parametrize(
    ("name", "kind"), [("127.0.0.1:5000/x:1", "engine-fetch"), ("srprov/talker:0123456789abcdef", "built-image")]
)
def test_an_image_that_nothing_of_a_plan_file_runs_asks_for_what_a_service_would(
    world: World, name: str, kind: str
) -> None:
    """Its engine asks whom the name says, and a service of another instance runs what has its tag."""
    saved = reread(planned(world))
    image = replace(resource("image", name, {"source": "pull"}), host="r1")
    with pytest.raises(UsageError, match=f"asks for {kind}"):
        check_file(replace(saved, also_wanted=(*saved.also_wanted, image)), "plan.json")
    run_here = {one.name for one in wants_of(saved) if one.module == "image"}
    assert run_here and not saved.plan.permissions


def test_a_plan_file_has_no_registry_asked_for_what_srprov_builds(world: World) -> None:
    """srprov's own playbooks never do: who has that name on Docker Hub is not who built it."""
    saved = reread(planned(world))
    image = replace(resource("image", "srprov/talker:0123456789abcdef", {"source": "pull"}), host="r1")
    change = Change(action=Action.CREATE, cause="")
    step = Step(number=99, host="r1", module="image", name=image.name, change=change, want=image)
    asked_for = {one.kind for one in asked(replace(saved, plan=replace(saved.plan, steps=(*saved.plan.steps, step))))}
    assert {"built-image", "playbook"} <= asked_for


@pytest.mark.parametrize(("service", "robot"), [("network.persist", "r1"), ("", "r1"), ("one", "r1\nr2")])
def test_who_runs_what_in_a_plan_file_has_names(world: World, service: str, robot: str) -> None:
    """A lab's policy looks there for the robot that a permission is about: one of all robots is nobody's service."""
    saved = reread(planned(world))
    assignment = {**saved.plan.assignment, service: robot}
    with pytest.raises(UsageError, match="cannot be the name"):
        load(dump(replace(saved, plan=replace(saved.plan, assignment=assignment))), "plan.json")


@pytest.mark.parametrize("wrong", ["elsewhere", "nobody", "no record"])
def test_a_plan_file_s_placement_is_that_of_what_it_wants(world: World, wrong: str) -> None:
    """It is shown, and what robots keep of it tells what a later file leaves out."""
    saved = reread(planned(world, FIRST))
    assignment, also = dict(saved.plan.assignment), saved.also_wanted
    if wrong == "elsewhere":
        assignment["two"], says = "r3", "assignment: 'two' is wanted on r2"
    elif wrong == "nobody":
        assignment["safety"], says = "r2", "assignment: 'safety' is said to run on r2, and nothing of it is wanted"
    else:
        also, says = (
            tuple(one for one in also if not one.name.endswith("placement.json")),
            r"permissions: r1/container:srprov.hello.one asks for playbook",
        )
    steps = tuple(one for one in saved.plan.steps if wrong != "no record" or not one.name.endswith("placement.json"))
    with pytest.raises(UsageError, match=says):
        check_file(replace(saved, plan=replace(saved.plan, assignment=assignment, steps=steps), also_wanted=also), "p")
