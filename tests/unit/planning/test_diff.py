"""From what should be and what is to steps: their order, their causes, and what they need."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.errors import PlanError
from srprov.planning.diff import diff, removal_plan
from srprov.planning.limit import limited
from srprov.planning.plan import Plan, Step, plan_json
from srprov.planning.text import plan_text, summary
from srprov.resource import Action, Need, Observed, Resource
from tests.fakes import World
from tests.resources import resource
from tests.worlds import CHECK, NetworkSettings, Service, apply, experiment, plan_for, removal_for, service


def volume(name: str, *needs: str, host: str = "r1") -> Resource:
    """Return a wanted volume: the simplest resource there is."""
    written = {"instance": "hello", "source": "s"}
    return resource("volume", name, written, host=host, needs=tuple(map(Need, needs)), source="p, 1")


def there(module: str, name: str, instance: str = "hello", **state: Any) -> Observed:
    """Return something that was found."""
    return Observed(module=module, name=name, instance=instance, state=state)


def shown(steps: Iterable[Step]) -> list[str]:
    """Return steps as short text."""
    return [f"{s.change.action.value} {s.host} {s.module} {s.name}" for s in steps]


def order(steps: Iterable[Step], *ids: str) -> list[str]:
    """Return those of the ids that have steps, in step order."""
    return [step.id for step in steps if step.id in ids]


def test_needs_come_first_whatever_the_names_say() -> None:
    """A step stands behind those it needs, although names would sort it first; its numbers name them."""
    steps, _ = diff([volume("a", "r2/volume:z"), volume("z", "r1/volume:m", host="r2"), volume("m")], {}, "hello")
    assert [step.name for step in steps] == ["m", "z", "a"]
    assert [step.needs for step in steps] == [(), (1,), (2,)]


def test_needs_reach_through_what_is_right() -> None:
    """If A needs B and B needs C, A comes after C also when B is right already."""
    found = {"r1": [there("volume", "b", source="s")]}
    steps, unchanged = diff([volume("a", "r1/volume:b"), volume("b", "r1/volume:c"), volume("c")], found, "hello")
    assert shown(steps) == ["+ r1 volume c", "+ r1 volume a"]
    assert steps[1].needs == (1,)
    assert unchanged == 1


def test_needs_reach_through_a_chain_of_thousands() -> None:
    """No experiment is so deep that Python would run out of levels."""
    right = {f"v{number}" for number in range(1, 3000)}
    wanted = [volume(f"v{number}", f"r1/volume:v{number + 1}") for number in range(3000)] + [volume("v3000")]
    found = {"r1": [there("volume", name, source="s") for name in right]}
    steps, unchanged = diff(wanted, found, "hello")
    assert [(step.name, step.needs) for step in steps] == [("v3000", ()), ("v0", (1,))]
    assert unchanged == 2999


def test_a_circle_is_refused_by_name() -> None:
    """Needs in a circle are an error that names all in it, not those that only wait for it."""
    circle = [volume("a", "r1/volume:b"), volume("b", "r1/volume:a"), volume("free")]
    with pytest.raises(PlanError, match="r1/volume:a, r1/volume:b") as caught:
        diff(circle, {}, "hello")
    assert "free" not in caught.value.message


def test_two_resources_with_one_id_are_refused() -> None:
    """Two wishes for one thing are a bug of a playbook, and both places are named."""
    with pytest.raises(PlanError, match=r"r1/volume:a stands in p, 1 and in q, 2"):
        diff([volume("a"), replace(volume("a"), source="q, 2")], {}, "hello")


def test_only_our_orphans_are_removed() -> None:
    """What carries our instance and is not wanted goes; volumes, images, other instances and nobody's things stay."""
    found = {
        "r1": [
            there("file", "/var/lib/srprov/hello/x", sha256=""),
            there("volume", "data"),
            there("image", "busybox:latest", ""),
            there("image", "labelled:latest", "hello"),
            there("file", "/var/lib/srprov/other/x", "other"),
            there("vxlan", "srpvhalf", ""),
        ]
    }
    steps, _ = diff([volume("a")], found, "hello")
    assert shown(steps) == ["- r1 file /var/lib/srprov/hello/x", "+ r1 volume a"]


def test_a_source_of_data_goes_only_where_this_plan_copies_it_or_its_copy_is_there() -> None:
    """Not when it is its own copy, nor when the robot that should have the copy is out of reach and no step copies."""

    def copy(label: str = "", host: str = "r2") -> Resource:
        return resource("volume", "v", {"instance": "hello", "source": "s", "from": "r1", "copy": label}, host=host)

    found = {"r1": [there("volume", "v")]}
    (copying,) = diff([copy()], {}, "hello")[0]
    assert shown(diff([copy()], found, "hello")[0]) == ["! r2 volume v", "- r1 volume v"]
    assert shown(diff([copy()], found, "hello", settled=[copy().id], beside=[copying])[0])[1:] == ["- r1 volume v"]
    assert diff([copy()], found, "hello", settled=[copy().id])[0] == ()
    for label, theirs, gone in (("", "", False), ("a", "b", False), ("a", "a", True)):
        both = {**found, "r2": [there("volume", "v", copy=theirs)]}
        assert [step.host for step in diff([copy(label)], both, "hello")[0]] == (["r1"] if gone else [])
    with pytest.raises(PlanError, match="cannot be copied from r1, where it is"):
        diff([copy(host="r1")], found, "hello")


def test_the_cause_of_a_removal_is_said() -> None:
    """A removal says whether a service moved, left, or was the robot's last."""
    world = World().add("r1", "r2", "r3")
    a, b, c = (service(name, robot=robot) for name, robot in (("a", "r1"), ("b", "r2"), ("c", "r3")))
    apply(world, experiment(a, b, c))
    plan = plan_for(world, experiment(service("a", robot="r2"), b))
    causes = {step.id: step.change.cause for step in plan.steps if step.change.action is Action.DELETE}
    assert causes["r1/container:srprov.hello.a"] == "moved to r2"
    assert causes["r3/container:srprov.hello.c"] == "no longer in the experiment"
    assert causes["r1/network:srprov.hello"] == "no service of the experiment here any more"


def test_a_moved_service_stops_before_it_starts() -> None:
    """The removal on the old robot is needed by the start on the new one, and the old network stays until then."""
    world = World().add("r1", "r2")
    apply(world, experiment(service("a", robot="r2"), service("b", robot="r1")))
    steps = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r1"))).steps
    old, new = "r2/container:srprov.hello.a", "r1/container:srprov.hello.a"
    assert order(steps, old, new) == [old, new]
    by_id = {step.id: step for step in steps}
    assert by_id[old].number in by_id[new].needs
    assert by_id[old].number in by_id["r2/network:srprov.hello"].needs


def test_two_services_that_change_places_form_no_circle() -> None:
    """Both stop first, then both start."""
    world = World().add("r1", "r2")
    apply(world, experiment(service("a", robot="r1"), service("b", robot="r2")))
    plan = plan_for(world, experiment(service("a", robot="r2"), service("b", robot="r1", depends_on={"a": "started"})))
    actions = [step.change.action for step in plan.steps if step.module == "container"]
    assert sorted(actions, key=lambda a: a is Action.CREATE) == [Action.DELETE] * 2 + [Action.CREATE] * 2


def test_a_removal_takes_containers_first_and_links_before_bridges() -> None:
    """On each robot containers go before what they stand on, and the link before the network that it is a port of."""
    world = World().add("r1")
    apply(world, experiment(service("a"), service("b")))
    steps = removal_for(world, volumes=True).steps
    modules = [step.module for step in steps]
    assert modules[:2] == ["container", "container"]
    assert modules.index("vxlan") < modules.index("network")
    network = next(step for step in steps if step.module == "network")
    assert {step.number for step in steps if step.module in ("container", "vxlan")} <= set(network.needs)


def test_a_removal_without_volumes_keeps_them() -> None:
    """Volumes go only when the user says so, and then the step says that data is lost."""
    found = {"r1": [there("volume", "data"), there("volume", "foreign", "other")]}
    assert removal_plan(found, "hello", volumes=False) == ()
    (step,) = removal_plan(found, "hello", volumes=True)
    assert (step.name, step.change.destructive, step.change.action) == ("data", True, Action.DELETE)
    plan = Plan(instance="hello", source="s", steps=(step,))
    assert "DATA IS LOST" in plan_text(plan)


@pytest.mark.parametrize("mode", ["host", "none"])
@pytest.mark.parametrize("others", [(), (service("b", robot="r1"),)])
def test_who_leaves_a_network_lets_go_of_it_first(mode: str, others: tuple[Service, ...]) -> None:
    """A container that wants another network from now on stops before its old one is removed or replaced."""
    world = World().add("r1")
    apply(world, experiment(service("a", robot="r1"), *others))
    what = experiment(service("a", robot="r1", network=mode), *others, network=NetworkSettings(mtu=1300))
    steps = plan_for(world, what).steps
    mine = [step for step in steps if step.name == "srprov.hello.a"]
    assert [step.change.action for step in mine] == [Action.DELETE, Action.CREATE]
    assert "network" in mine[0].change.cause
    assert mine[0].number in next(step for step in steps if step.module == "network").needs
    assert apply(world, what).exit_code == 0
    assert plan_for(world, what).empty


def test_a_replaced_network_counts_what_it_rebuilds() -> None:
    """Containers that were right are no longer counted as unchanged when their network takes them along."""
    world = World().add("r1")
    apply(world, experiment(service("a")))
    before = plan_for(world, experiment(service("a")))
    after = plan_for(world, experiment(service("a"), network=NetworkSettings(mtu=1300)))
    assert before.unchanged == 7
    assert after.unchanged + len({step.id for step in after.steps}) == 7


def test_permuted_inputs_give_the_same_steps() -> None:
    """The order of wishes, of robots and of what was found says nothing."""
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2", depends_on={"a": "started"}))
    wanted = [step.want for step in plan_for(world, what).steps if step.want]
    found = {
        "r1": [there("file", f"/var/lib/srprov/hello/{n}", sha256="") for n in "abc"],
        "r2": [there("volume", "v"), there("tree", "/var/lib/srprov/hello/trees/x")],
    }
    first = diff(wanted, found, "hello")
    for _, hosts in itertools.product(range(3), (["r1", "r2"], ["r2", "r1"])):
        wanted.append(wanted.pop(0))
        assert diff(wanted, {host: found[host][::-1] for host in hosts}, "hello") == first


def test_waits_are_the_conditions_that_take_time() -> None:
    """`healthy` and `completed` are waited for; `started` and `present` are only an order."""
    world = World().add("r1")
    what = experiment(
        service("a", healthcheck=CHECK),
        service("b", job=True),
        service("c", depends_on={"a": "healthy", "b": "completed"}),
        service("d", depends_on={"a": "started"}),
    )
    waits = {
        step.service: [need.condition for need in step.waits] for step in plan_for(world, what).steps if step.service
    }
    assert waits == {"a": [], "b": [], "c": ["healthy", "completed"], "d": []}


# -- limit -------------------------------------------------------------------------------------------------------------


def two_robots() -> Plan:
    """Return a plan in which r2's service needs r1's."""
    what = experiment(service("a", robot="r1"), service("b", robot="r2", depends_on={"a": "started"}))
    return plan_for(World().add("r1", "r2"), what)


def test_limit_to_everything_is_the_plan() -> None:
    """A limit that leaves nothing out changes nothing, not even a note."""
    plan = two_robots()
    assert limited(plan, {"r1", "r2", "r3"}) is plan


def test_limit_keeps_numbers_and_leaves_out_what_needs_the_rest() -> None:
    """Steps keep their numbers; those that need a step on another robot are left out, and the note counts them."""
    plan = two_robots()
    only = limited(plan, {"r2"})
    kept = {step.number: step for step in plan.steps}
    assert all(kept[step.number] == step for step in only.steps)
    assert {step.host for step in only.steps} == {"r2"}
    assert "container" not in {step.module for step in only.steps}
    assert any("1 of them stand on chosen robots" in note for note in only.notes)
    assert any("steps are left out" in note for note in only.notes)


def test_limit_to_nothing_is_empty_and_decides_nothing_else() -> None:
    """The placement and what the user is asked to allow stay as they are."""
    plan = two_robots()
    none = limited(plan, ())
    assert none.empty
    assert (none.assignment, none.permissions) == (plan.assignment, plan.permissions)


def test_a_limited_plan_runs() -> None:
    """What a limit leaves can be done, and the rest is done by the next apply."""
    from tests.worlds import run

    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2", depends_on={"a": "started"}))
    assert run(world, limited(plan_for(world, what), {"r2"})).exit_code == 0
    assert world.running() == []
    assert apply(world, what).exit_code == 0
    assert world.running() == [("a", "r1"), ("b", "r2")]
    assert plan_for(world, what).empty


# -- text and JSON -----------------------------------------------------------------------------------------------------


def test_a_robot_cannot_write_lines_of_the_plan() -> None:
    """Control characters in what robots say are shown by number; no name begins a line or colours the terminal."""
    name = "/var/lib/srprov/hello/x\n  + #1 file /etc/passwd: all is well\x1b[2J\x9b"
    steps, _ = diff([volume("a")], {"r1": [there("file", name, sha256="")]}, "hello")
    text = plan_text(Plan(instance="hello", source="s", steps=steps, unreachable={"r9": "gone\x07\nis it up?"}))
    assert "\\n  + #1 file /etc/passwd" in text
    assert all(c.isprintable() for line in text.split("\n") for c in line)
    assert "unreachable: r9: gone\\x07\n  hint: is it up?\n" in text


def test_summary_counts_actions_in_words() -> None:
    """The last line counts what is done by its kind, and leaves out what does not occur."""
    assert summary(two_robots()).startswith("Plan: 14 to add; 0 unchanged.")
    assert summary(Plan(instance="i", source="s", steps=(), unchanged=3)).startswith("Nothing to do")


def test_plan_json_is_canonical_and_holds_only_json() -> None:
    """Equal plans give equal JSON, which survives a round trip; commands are in it exactly, bytes by their digest."""
    first, second = plan_json(two_robots()), plan_json(two_robots())
    assert json.dumps(first) == json.dumps(second)
    assert json.loads(json.dumps(first)) == first
    by_module = {step["module"]: step for step in first["steps"]}
    assert by_module["container"]["robot"] == "r2"
    assert by_module["container"]["needs"] == [7, 8, 9, 11, 12]
    assert by_module["image"]["commands"] == [
        {"engine": "POST", "path": "/images/create", "params": {"fromImage": "busybox", "tag": "latest"}}
    ]
    assert set(by_module["file"]["commands"][0]) == {"put", "bytes", "sha256", "mode", "in_place"}
    guard, notify, calls = by_module["vxlan"]["commands"][0]["run"].split("\n", 2)
    assert guard.endswith("exit 1 ;; esac") and notify.endswith("/arp_notify || exit")
    assert calls.startswith("printf %s 'link add") and "\n' | ip -batch - || exit" in calls
    assert first["counts"] == {"create": 14, "update": 0, "replace": 0, "delete": 0, "run": 0}
