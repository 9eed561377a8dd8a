"""Plans as text, compared byte for byte with `tests/golden/plan-*.txt`.

A golden file is what a user sees; a change of it is a change of behaviour and is reviewed as such. After a wanted one:

    SRPROV_UPDATE_GOLDEN=1 pytest tests/unit/planning/test_golden.py

writes the files anew, and `git diff tests/golden` shows what a user would see.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from srprov.definitions.playbook import read
from srprov.definitions.playbookmodel import ADDED, AFTER, BEFORE
from srprov.planning.plan import Plan
from srprov.planning.text import plan_text
from tests.fakes import World
from tests.worlds import CHECK, Experiment, Mount, NetworkSettings, apply, experiment, plan_for, removal_for, service

GOLDEN = Path(__file__).parents[2] / "golden"
UPDATE = bool(os.environ.get("SRPROV_UPDATE_GOLDEN"))

WEB = service("web", robot="r1", healthcheck=CHECK, mounts=(Mount(kind="volume", source="log", target="/log"),))
GREETER = service("greeter", robot="r2", depends_on={"web": "started"})
ONCE = service("once", robot="r3", job=True, depends_on={"web": "healthy"})


def three(*more: object, **fields: object) -> Experiment:
    """Return the experiment with three services on three robots."""
    return experiment(WEB, GREETER, ONCE, *more, **fields)  # type: ignore[arg-type]


def applied(what: Experiment | None = None) -> World:
    """Return three robots on which the experiment is true."""
    world = World().add("r1", "r2", "r3")
    assert apply(world, what or three()).exit_code == 0
    return world


def fresh() -> Plan:
    """A dependency that must be healthy crosses robots."""
    return plan_for(World().add("r1", "r2", "r3"), three())


def nothing() -> Plan:
    """A second plan finds nothing to do."""
    return plan_for(applied(), three())


def move() -> Plan:
    """A service that moves stops before it starts elsewhere; the others learn its new place and go on."""
    return plan_for(applied(), experiment(WEB, service("greeter", robot="r3", depends_on={"web": "started"}), ONCE))


def removal() -> Plan:
    """All of an instance goes, volumes excepted."""
    return removal_for(applied())


def removal_with_volumes() -> Plan:
    """With volumes, the plan says that data is lost."""
    return removal_for(applied(), volumes=True)


def network_replaced() -> Plan:
    """What stands on a network that must be made anew goes before and comes back after."""
    return plan_for(applied(), three(network=NetworkSettings(subnet="10.222.0.0/24")))


def drift() -> Plan:
    """What somebody changed by hand, one of each kind."""
    world = applied()
    r1, r2, r3 = (world.robots[name] for name in ("r1", "r2", "r3"))
    r1.engine.containers["srprov.hello.web"].state = "paused"
    r1.disk.files["/var/lib/srprov/hello/hosts"] = b"edited\n"
    r1.engine.volumes.clear()
    r2.engine.images.clear()
    r2.kernel.reboot()
    r2.engine.containers["srprov.hello.greeter"].state = "exited"
    r2.disk.files["/var/lib/srprov/hello/stray"] = b"x"
    r3.kernel.links[next(n for n in r3.kernel.links if n.startswith("srpv"))].mtu = 1200
    r3.disk.files.pop("/var/lib/srprov/hello/placement.json")
    r3.engine.networks["srprov.hello"]["Options"]["com.docker.network.driver.mtu"] = "900"
    return plan_for(world, three())


def permissions() -> Plan:
    """What reaches beyond the experiment's own containers is listed first."""
    greedy = service(
        "greedy",
        robot="r1",
        network="host",
        privileged=True,
        pid="host",
        devices=(("/dev/video0", "/dev/video0", "rw"),),
        mounts=(
            Mount(kind="bind", source="/var/run/docker.sock", target="/s"),
            Mount(kind="bind", source="/data", target="/data", read_only=True),
        ),
    )
    return plan_for(World().add("r1"), experiment(greedy))


def playbooks() -> Plan:
    """What the experiment's and the user's own playbooks add, with the exact commands."""
    lines = {
        BEFORE: "- command: driver\n  argv: [modprobe, uvcvideo]\n  unless: test -e /dev/video0\n",
        AFTER: '- file: {{ folder ~ "/done" }}\n  content: x\n  needs: [{{ "container:srprov.hello.web" }}]\n',
        ADDED: "- command: mark\n  shell: touch /opt/m\n  creates: /opt/m\n",
    }
    made = {}
    with tempfile.TemporaryDirectory() as folder:
        for place, text in lines.items():
            file = Path(folder) / f"{place}.yml"
            file.write_text(text)
            made[place] = replace(read(str(file), file.name, file.name, place), file=f"/p/{file.name}")
    what = experiment(WEB, playbooks=(made[BEFORE], made[AFTER]))
    return plan_for(World().add("r1"), what, allowed=frozenset({"playbook"}), playbooks=(made[ADDED],))


def unreachable() -> Plan:
    """A robot that cannot be reached keeps its service; the others are planned all the same."""
    world = applied()
    world.robots["r3"].gone = True
    changed = service("greeter", robot="r2", command=("greet", "twice"), depends_on={"web": "started"})
    return plan_for(world, experiment(WEB, changed, ONCE))


def new_and_gone() -> Plan:
    """One service leaves the experiment and another one joins it."""
    return plan_for(applied(), experiment(WEB, GREETER, service("logger", robot="r2")))


def values() -> Plan:
    """What changes is told by field, a shipped file line by line."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "app.yml"
        mount = Mount(kind="tree", source=str(file), target="/etc/app.yml", read_only=True)
        file.write_text("level: 1\nrate: 2\n")
        world = applied(three(service("app", robot="r2", environment={"RATE": "2", "OLD": "x y"}, mounts=(mount,))))
        file.write_text("level: 1\nrate: 4\n")
        ports = (("", 8080, 80, "tcp"),)
        environment = {"RATE": "4", "DB_PASSWORD": "hunter22"}
        return plan_for(world, three(service("app", robot="r2", environment=environment, ports=ports, mounts=(mount,))))


SCENES: tuple[Callable[[], Plan], ...] = (
    fresh, nothing, move, removal, removal_with_volumes, network_replaced, drift, permissions, unreachable,
    new_and_gone, playbooks, values,
)  # fmt: skip


def priced(plan: Plan) -> Plan:
    """Return the plan with fixed costs: what a placement costs is assignment's to say, and tested there."""
    return replace(plan, cost=0.5 * len(plan.costs), costs=dict.fromkeys(plan.costs, 0.5))


def compared(name: str, text: str) -> None:
    """Compare with the file, or write it."""
    path = GOLDEN / f"plan-{name}.txt"
    if UPDATE:
        path.write_text(text, encoding="utf-8")
    assert path.read_text(encoding="utf-8") == text


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.__name__)
def test_plan_text(scene: Callable[[], Plan]) -> None:
    """The plan's text is what the golden file says, byte for byte."""
    compared(scene.__name__, plan_text(priced(scene())))


def test_plan_text_with_commands() -> None:
    """With commands, every step shows exactly what it runs; long content by its digest."""
    compared("fresh-commands", plan_text(priced(fresh()), commands=True))


def test_no_golden_file_is_left_over() -> None:
    """Every golden file belongs to a scene."""
    names = {f"plan-{scene.__name__}" for scene in SCENES}
    assert {path.stem for path in GOLDEN.glob("plan-*.txt")} == names | {"plan-fresh-commands"}
