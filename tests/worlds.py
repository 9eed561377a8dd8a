"""Experiments and robots for tests: as short as what they are about."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from types import MappingProxyType, SimpleNamespace
from typing import Any
from unittest import mock

from srprov.controller import ownership, plan
from srprov.controller.fleet import Fleet
from srprov.controller.remove import make_removal
from srprov.controller.request import PlanRequest
from srprov.definitions.containermodel import HealthCheck, Mount, Runtime
from srprov.definitions.model import Definitions, Experiment, Host, Inventory, NetworkSettings, Placement, Service
from srprov.execution import Event, RunOptions, RunResult, run_plan
from srprov.facts.gather import Gathering
from srprov.facts.placements import parse_placements
from srprov.planning.plan import Plan
from srprov.record.memory import Memory, digest
from srprov.secret import Vault
from srprov.wire import Reply
from tests.fakes import World

AS_IT_IS = PlanRequest()
EDF = "/e/hello.edf"
CHECK = HealthCheck(test=("CMD", "true"), interval_s=1.0, timeout_s=1.0, retries=3)
QUICK = RunOptions(settle_s=0.0, wait_timeout_s=5.0)


def service(name: str, **fields: Any) -> Service:
    """Return a service; run-time fields such as `command` or `job` may stand beside its own."""
    own = {"cost", "requires", "network", "depends_on", "robot", "image", "profiles", "secrets"}
    run = {key: value for key, value in fields.items() if key not in own}
    mine = {key: value for key, value in fields.items() if key in own}
    mine["depends_on"] = MappingProxyType(dict(mine.get("depends_on", {})))
    return Service(name=name, runtime=Runtime(**run), **{"image": "busybox", **mine})


def experiment(*services: Service, name: str = "hello", slots: int = 8, **fields: Any) -> Experiment:
    """Return an experiment; robots have room for all of it."""
    by_name = {one.name: one for one in sorted(services, key=lambda s: s.name)}
    wishes = {"placement": Placement(slots_per_robot=slots), **fields}
    return Experiment(name=name, file=f"/e/{name}.edf", folder="/e", services=by_name, **wishes)


def inventory(world: World) -> Inventory:
    """Return the inventory of a world's robots; each has a camera and a GPU."""
    has = {"devices": ("/dev/video0", "/dev/x"), "tags": ("gpu",)}
    hosts = {name: Host(name=name, address=robot.kernel.address, **has) for name, robot in world.robots.items()}
    return Inventory(hosts=hosts, groups={})


def plan_for(world: World, what: Experiment, **wishes: Any) -> Plan:
    """Make the plan of an experiment on a world."""
    definitions = Definitions(experiment=what, containers={})
    request = PlanRequest(**wishes)
    with mock.patch.object(plan, "source_of", return_value=f"lab@desk:{what.file}"):
        return made(world, definitions, request).plan


def made(
    world: World, definitions: Definitions, request: PlanRequest = AS_IT_IS, vault: Vault | None = None,
) -> plan.Planned:  # fmt: skip
    """Make a plan with all that led to it."""
    engine = request.exact or any(one.requires.disk for one in definitions.experiment.services.values())
    ports = any(one.runtime.ports or one.runtime.expose for one in definitions.experiment.services.values())
    with remembering_all(world), Gathering(inventory(world), world.reader, engine=engine, ports=ports) as look:
        return plan.make_plan(definitions, look, request, vault or Vault())


def fleet(world: World) -> Fleet:
    """Return the robots of a world, connected."""
    return Fleet(inventory(world), SimpleNamespace(get=world.reader, connected=world.sessions), forks=8)  # type: ignore[arg-type]


def removal_for(world: World, instance: str = "hello", *, volumes: bool = False) -> Plan:
    """Make the plan that removes an instance."""
    with remembering_all(world):
        return make_removal(fleet(world), instance, volumes=volumes).plan


def remembering_all(world: World) -> AbstractContextManager[object]:
    """Let plans believe every robot's record, as if this machine's last run had given it to all of them."""

    def remembered(instance: str) -> Memory:
        held = [parse_placements(Reply(status=0, out=robot.disk.records())) for robot in world.robots.values()]
        records = sorted((one[instance] for one in held if instance in one), key=lambda record: int(record["serial"]))
        proofs = {name: robot.identity for name, robot in world.robots.items()}
        return Memory(robots=frozenset(world.robots), records=tuple(map(digest, records)), proofs=proofs)

    return mock.patch.object(ownership, "recall", remembered)


def run(world: World, plan: Plan, options: RunOptions = QUICK) -> RunResult:
    """Do a plan."""
    return run_plan(plan, world.sessions(), lambda _event: None, options)


def apply(world: World, what: Experiment, options: RunOptions = QUICK) -> RunResult:
    """Plan and do."""
    return run(world, plan_for(world, what), options)


def events(world: World, plan: Plan, options: RunOptions = QUICK) -> tuple[RunResult, list[Event]]:
    """Do a plan and give what a listener was told."""
    heard: list[Event] = []
    return run_plan(plan, world.sessions(), heard.append, options), heard


__all__ = [
    "CHECK", "EDF", "QUICK", "Experiment", "HealthCheck", "Mapping", "Mount", "NetworkSettings", "RunOptions",
    "Service", "apply", "events", "experiment", "inventory", "plan_for", "removal_for", "run", "service",
]  # fmt: skip
