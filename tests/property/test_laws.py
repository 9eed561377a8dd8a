"""Laws for every experiment, every older version of it on the robots, and any drift; on robots in memory.

an applied experiment has an empty plan, and a second apply sends nothing but questions
the order of hosts, services and of what robots list does not reach the plan's text
no container starts before what it depends on is started, healthy or completed, nor before its robot is on the overlay
no service ever runs twice
a removal leaves nothing of the instance, and everything of others
after a failure at any command, the next apply ends where an undisturbed one would have
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck as Hypothesis
from hypothesis import given, note, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from srprov.execution import RunOptions, conditions
from srprov.planning.text import plan_text
from tests.conftest import examples
from tests.fakes import Behaviour, Fault, World
from tests.worlds import (
    CHECK,
    Experiment,
    Mount,
    NetworkSettings,
    apply,
    experiment,
    plan_for,
    removal_for,
    run,
    service,
)

ROBOTS = ("r1", "r2", "r3")
NAMES = ("job1", "a", "job2", "b", "c")
"""In the order in which they may depend on each other; those named so are jobs."""
FAST = RunOptions(settle_s=0.0, wait_timeout_s=3.0)
ONE = RunOptions(settle_s=0.0, wait_timeout_s=3.0, forks=1)
LIMITS = settings(
    derandomize=True,
    deadline=None,
    max_examples=examples(40),
    suppress_health_check=[Hypothesis.too_slow, Hypothesis.data_too_large],
)


@pytest.fixture(autouse=True, scope="module")
def quick_polls() -> Iterator[None]:
    """Poll at once: robots in memory need no time to become healthy."""
    before = conditions._FIRST_PAUSE_S, conditions._LONGEST_PAUSE_S
    conditions._FIRST_PAUSE_S = conditions._LONGEST_PAUSE_S = 0.0005
    yield
    conditions._FIRST_PAUSE_S, conditions._LONGEST_PAUSE_S = before


WWW = str(Path(__file__).parents[1] / "cases" / "shipped")
"""A folder to ship; it holds as little as possible."""
MOUNTS = {
    "volume": Mount(kind="volume", source="data", target="/data"),
    "tree": Mount(kind="tree", source=WWW, target="/www"),
    "bind": Mount(kind="bind", source="/dev/shm", target="/shm"),
    "tmpfs": Mount(kind="tmpfs", source="", target="/t"),
}


@st.composite
def experiments(draw: st.DrawFn) -> Experiment:
    """Return an experiment of some of five services; each may depend on those before it."""
    chosen = draw(st.sets(st.sampled_from(NAMES), min_size=1, max_size=4))
    names = [name for name in NAMES if name in chosen]
    jobs = {name for name in names if name.startswith("job")}
    checked = {name for name in names if name not in jobs and draw(st.booleans())}
    services = []
    for index, name in enumerate(names):
        depends = {}
        for other in names[:index]:
            if draw(st.integers(0, 2)) == 0:
                possible = ["started"] + ["completed"] * (other in jobs) + ["healthy"] * (other in checked)
                depends[other] = draw(st.sampled_from(possible))
        services.append(
            service(
                name,
                robot=draw(st.sampled_from(ROBOTS)),
                network=draw(st.sampled_from(["overlay", "overlay", "overlay", "both", "host", "none"])),
                depends_on=depends,
                job=name in jobs,
                healthcheck=CHECK if name in checked else None,
                command=("run", str(draw(st.integers(0, 1)))),
                image=draw(st.sampled_from(["busybox", "busybox:1.36"])),
                mounts=tuple(MOUNTS[key] for key in sorted(draw(st.sets(st.sampled_from(sorted(MOUNTS)), max_size=2)))),
            )
        )
    wishes = NetworkSettings(
        mtu=draw(st.sampled_from([None, None, 1300])), subnet=draw(st.sampled_from([None, None, "10.222.0.0/24"]))
    )
    return experiment(*services, network=wishes)


Drift = Callable[[World, str, st.DataObject], None]


def _container(change: str) -> Drift:
    def drift(world: World, host: str, data: st.DataObject) -> None:
        engine = world.robots[host].engine
        ours = sorted(n for n, c in engine.containers.items() if c.body["Labels"].get("srprov.instance") == "hello")
        if ours:
            name = data.draw(st.sampled_from(ours))
            if change == "removed":
                del engine.containers[name]
            elif change == "edited":
                body = copy.deepcopy(engine.containers[name].body)
                body["Labels"]["srprov.config-hash"] = "0" * 64
                engine.containers[name].body = body
            else:
                engine.containers[name].state = change
                engine.containers[name].code = 7

    return drift


LINK_DRIFTS: dict[str, Any] = {"mtu": 1000, "up": False, "alias": "", "vni": 3, "learning": True, "master": ""}
CONTAINER_DRIFTS = ("removed", "edited", "exited", "paused", "dead", "created", "restarting")


def _kernel(change: str) -> Drift:
    def drift(world: World, host: str, data: st.DataObject) -> None:
        kernel = world.robots[host].kernel
        links = [link for link in kernel.links.values() if link.alias == "srprov:hello"]
        if change == "reboot":
            kernel.reboot()
        for link in links if change != "reboot" else ():
            if change == "deleted":
                assert not kernel.run(f"ip link del dev {link.name}")
            elif change == "entry":
                kernel.fdb.add((link.name, "02:00:00:00:00:99", "10.9.9.9"))
            elif change == "no entries":
                kernel.fdb.clear()
            elif change == "addresses":
                bridge = kernel.links.get(link.master)
                if bridge is not None:
                    bridge.services ^= {"10.9.9.9", *sorted(bridge.services)[:1]}
                    bridge.mac = "32:00:00:00:00:01"
            else:
                setattr(link, change, LINK_DRIFTS[change])

    return drift


def _file(change: str) -> Drift:
    def drift(world: World, host: str, data: st.DataObject) -> None:
        disk = world.robots[host].disk
        ours = sorted(path for path in disk.files if path.startswith("/var/lib/srprov/hello/"))
        if change == "stray":
            disk.files["/var/lib/srprov/hello/stray"] = b"x"
        elif change == "half tree":
            disk.files["/var/lib/srprov/hello/trees/abc.tar"] = b"x"
        elif ours and change == "removed":
            del disk.files[data.draw(st.sampled_from(ours))]
        elif ours:
            disk.files[data.draw(st.sampled_from(ours))] = b"edited"

    return drift


def _engine(change: str) -> Drift:
    def drift(world: World, host: str, data: st.DataObject) -> None:
        engine = world.robots[host].engine
        if change == "images":
            engine.images.clear()
        elif "srprov.hello" in engine.networks:
            network = copy.deepcopy(engine.networks["srprov.hello"])
            network["Options"]["com.docker.network.driver.mtu"] = "900"
            engine.networks["srprov.hello"] = network

    return drift


DRIFTS: dict[str, Drift] = {
    **{f"container {c}": _container(c) for c in CONTAINER_DRIFTS},
    **{f"link {c}": _kernel(c) for c in ("reboot", "deleted", "entry", "no entries", "addresses", *LINK_DRIFTS)},
    **{f"file {c}": _file(c) for c in ("stray", "half tree", "removed", "edited")},
    **{f"engine {c}": _engine(c) for c in ("images", "network")},
}  # fmt: skip


def new_world(data: st.DataObject) -> World:
    """Return three robots whose jobs end and whose services become healthy after a while."""
    world = World().add(*ROBOTS)
    for name in NAMES:
        lives = data.draw(st.integers(0, 2), label=f"{name} lives or is healthy after")
        for robot in world.robots.values():
            robot.engine.behaviours[name] = Behaviour(
                exits=0 if name.startswith("job") else None, lives=lives, healthy_after=lives
            )
    return world


def strangers(world: World) -> None:
    """Add what is not ours: a foreign container, network, volume, link and file, and another instance."""
    other = experiment(service("a", robot="r1"), service("x", robot="r2", mounts=(MOUNTS["volume"],)), name="other")
    for robot in world.robots.values():
        robot.engine.behaviours.pop("x", None)
        robot.engine.run_foreign("foreign")
        robot.kernel.add_bridge("br-foreign", 1500)
        robot.engine.volumes["foreign"] = {}
        robot.disk.files["/etc/hosts"] = b"foreign"
    assert apply(world, other, FAST).exit_code == 0


def others(state: Any) -> Any:
    """Return everything of a world's state that is not instance hello's; an instance's things are known by name."""
    if isinstance(state, dict):
        own = lambda key: "srprov.hello" in str(key) or "/hello/" in str(key) or key in LINKS  # noqa: E731
        return {key: others(value) for key, value in state.items() if not own(key)}
    if isinstance(state, list):
        return [one for one in state if not (isinstance(one, tuple) and one[0] in LINKS)]
    return state


LINKS = ("srpbabf8c589", "srpvabf8c589")


def settled(world: World) -> dict[str, Any]:
    """Return the state with jobs that still run taken for jobs that ended: when they end is not srprov's to say."""
    state = world.state()
    for name, robot in world.robots.items():
        for container in robot.engine.containers.values():
            behaviour = robot.engine.behaviours.get(container.service)
            if behaviour and behaviour.exits is not None and container.state == "running":
                state[name]["containers"][container.name] = ("exited", behaviour.exits, container.body)
    return state


def in_order(world: World, what: Experiment) -> None:
    """Check in the log that each start came after what its service depends on."""
    homes = {name: one.robot for name, one in what.services.items()}
    for entry in world.log:
        if entry.kind != "started":
            continue
        name = str(entry.what).rpartition(".")[2]
        for other, condition in what.services[name].depends_on.items():
            state, health = entry.seen.get(f"{homes[other]}/srprov.hello.{other}", ("not there", ""))
            ended = what.services[other].runtime.job and state == "exited 0"
            right = {
                "started": state == "running 0" or ended,
                "healthy": health == "healthy",
                "completed": state == "exited 0",
            }[condition]
            assert right, f"{name} started while {other} was {state} {health}, not {condition}"


def before(world: World, old: Experiment | None, drifts: list[tuple[str, str]], data: st.DataObject) -> None:
    """Bring robots into the state that the law is about: an older version and what somebody changed since."""
    if old is not None:
        assert apply(world, old, FAST).exit_code == 0
        for host, drift in drifts:
            DRIFTS[drift](world, host, data)
    world.log.clear()
    world.doubles.clear()
    world.early.clear()


SOME_DRIFT = st.lists(st.tuples(st.sampled_from(ROBOTS), st.sampled_from(sorted(DRIFTS))), max_size=3)


@LIMITS
@given(old=st.none() | experiments(), what=experiments(), drifts=SOME_DRIFT, data=st.data())
def test_an_applied_experiment_is_true(
    old: Experiment | None, what: Experiment, drifts: list[tuple[str, str]], data: st.DataObject
) -> None:
    """One apply makes it true from any state, in the right order and nothing twice; a second one only asks."""
    world = new_world(data)
    before(world, old, drifts, data)
    plan = plan_for(world, what)
    note(plan_text(plan))
    result = run(world, plan, FAST)
    assert result.exit_code == 0, [(r.step.id, r.outcome, r.message) for r in result.results]
    assert world.doubles == [] and world.early == []
    in_order(world, what)
    again = plan_for(world, what)
    assert again.empty, plan_text(again)
    sent = len(world.done())
    assert run(world, again, FAST).exit_code == 0
    assert len(world.done()) == sent
    homes = sorted((name, one.robot) for name, one in what.services.items())
    assert [pair for pair in world.running() if not what.services[pair[0]].runtime.job] == [
        pair for pair in homes if not what.services[pair[0]].runtime.job
    ]


@LIMITS
@given(old=st.none() | experiments(), what=experiments(), drifts=SOME_DRIFT, data=st.data())
def test_order_says_nothing(
    old: Experiment | None, what: Experiment, drifts: list[tuple[str, str]], data: st.DataObject
) -> None:
    """Permuted hosts, services and lists of what is there give byte-equal plans."""
    world = new_world(data)
    before(world, old, drifts, data)
    text = plan_text(plan_for(world, what), commands=True)

    def shuffled(mapping: dict[str, Any]) -> dict[str, Any]:
        return {key: mapping[key] for key in data.draw(st.permutations(sorted(mapping)))}

    world.robots = shuffled(world.robots)
    for robot in world.robots.values():
        for kind in ("containers", "networks", "volumes", "images"):
            setattr(robot.engine, kind, shuffled(getattr(robot.engine, kind)))
        robot.kernel.links = shuffled(robot.kernel.links)
    permuted = replace(what, services=shuffled(dict(what.services)))
    assert plan_text(plan_for(world, permuted), commands=True) == text


@LIMITS
@given(what=experiments(), drifts=SOME_DRIFT, volumes=st.booleans(), data=st.data())
def test_a_removal_leaves_others_alone(
    what: Experiment, drifts: list[tuple[str, str]], volumes: bool, data: st.DataObject
) -> None:
    """Nothing of the instance stays, volumes excepted; everything of others does; a second removal is empty."""
    world = new_world(data)
    strangers(world)
    before(world, what, [drift for drift in drifts if drift[1] not in ("link alias", "engine images")], data)
    foreign = others(settled(world))
    plan = removal_for(world, volumes=volumes)
    note(plan_text(plan))
    result = run(world, plan, FAST)
    assert result.exit_code == 0, [(r.step.id, r.outcome, r.message) for r in result.results]
    assert removal_for(world, volumes=volumes).empty
    assert others(settled(world)) == foreign
    for robot in world.robots.values():
        engine = robot.engine
        assert not [n for n in (*engine.containers, *engine.networks) if n.startswith("srprov.hello")]
        assert not [p for p in (*robot.disk.files, *robot.disk.trees) if "/hello/" in p]
        assert not [n for n in robot.kernel.links if n in LINKS]
        assert bool([n for n in engine.volumes if n.startswith("srprov.hello")]) <= (not volumes)


@LIMITS
@given(
    old=st.none() | experiments(),
    what=experiments(),
    how=st.sampled_from(["refuse", "half", "lost", "lost-after"]),
    at=st.integers(1, 30),
    data=st.data(),
)
def test_a_failure_is_healed_by_the_next_apply(
    old: Experiment | None, what: Experiment, how: str, at: int, data: st.DataObject
) -> None:
    """Whichever command fails, and however, the next apply ends where an undisturbed one would have ended."""
    world = new_world(data)
    before(world, old, [], data)
    calm = copy_of(world)
    assert apply(calm, what, ONE).exit_code == 0
    world.fault = Fault(at=world.commands + at, how=how)
    failed = run(world, plan_for(world, what), ONE)
    hit = world.commands >= world.fault.at
    note(f"failed: {[(r.step.id, r.outcome.value, r.message) for r in failed.results if r.message]}")
    assert (failed.exit_code != 0) == hit or how == "half"
    world.fault = None
    for robot in world.robots.values():
        robot.gone = False
    plan = plan_for(world, what)
    note(plan_text(plan))
    healed = run(world, plan, FAST)
    assert healed.exit_code == 0, [(r.step.id, r.outcome, r.message) for r in healed.results]
    assert plan_for(world, what).empty
    assert world.doubles == [] and world.early == []
    in_order(world, what)
    assert settled(world) == settled(calm)


def copy_of(world: World) -> World:
    """Return another world in the same state."""
    twin = World().add(*world.robots)
    for name, robot in world.robots.items():
        mine = twin.robots[name]
        for kind in ("containers", "networks", "volumes", "images", "behaviours"):
            setattr(mine.engine, kind, copy.deepcopy(getattr(robot.engine, kind)))
        for part in ("links", "fdb"):
            setattr(mine.kernel, part, copy.deepcopy(getattr(robot.kernel, part)))
        for part in ("files", "modes", "inodes", "trees", "serial"):
            setattr(mine.disk, part, copy.deepcopy(getattr(robot.disk, part)))
    return twin
