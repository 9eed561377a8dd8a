"""What robots must have and have not for containers that are new: folders that services mount, and free ports.

Docker would say so too, in the middle of a run; here it is a clear error of the plan. Asks only robots that get such a
container, in one round trip; with nothing new it asks nobody.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Protocol

from msgspec.structs import replace

from srprov.assignment.ports import declared, holders, missing_ports
from srprov.codes import Code
from srprov.controller.robots_notes import (
    ASKED,
    STARTING,
    Leads,
    asked_of,
    binds,
    leads_of,
    led_elsewhere,
    missing_folders,
    of_those_that_told,
    told,
)
from srprov.definitions.model import Experiment, Service
from srprov.errors import UsageError
from srprov.facts.gather import Gathering
from srprov.facts.model import Snapshot, TakenPort
from srprov.facts.probes import INFO
from srprov.facts.taken import QUERIES, taken_ports
from srprov.modules import RUNNING
from srprov.modules.mount_kind import GRAVE
from srprov.planning.plan import Step
from srprov.resource import Action, Resource
from srprov.untrusted import integer, mapping, text

_NEW = (Action.CREATE, Action.REPLACE)


def of_others(
    snapshot: Snapshot, instance: str, experiment: Experiment, previous: Mapping[str, str]
) -> dict[str, tuple[TakenPort, ...]]:
    """Return the ports that others than this instance have, per robot that was asked.

    A service with the robot's network listens itself: the ports that a running one exposes are not somebody else's.
    """
    own: dict[str, set[tuple[int, str]]] = {}
    for name, robot in previous.items():
        service = experiment.services.get(name)
        if service and service.network in ("host", "both"):
            own.setdefault(robot, set()).update(service.runtime.expose)
    return {
        robot: tuple(
            one
            for one in (*taken, *_of_overlays(snapshot, robot))
            if one.instance != instance and (one.port, one.protocol) not in own.get(robot, ())
        )
        for robot, taken in snapshot.taken.items()
    }


def _of_overlays(snapshot: Snapshot, robot: str) -> Iterator[TakenPort]:
    """Return the ports of a robot's overlays: also without their links, as since it booted, members send to them."""
    for thing in snapshot.observed.get(robot, ()):
        port = integer(thing.state.get("port", 0), high=65535) if thing.module == "network" else 0
        if port:
            by = f"the overlay of instance '{thing.instance}'"
            yield TakenPort(address="", port=port, protocol="udp", by=by, instance=thing.instance)


class Placed(Protocol):
    """An experiment with every instance, and where its services run now."""

    @property
    def experiment(self) -> Experiment:
        """Return the experiment."""

    @property
    def previous(self) -> Mapping[str, str]:
        """Return service -> robot."""


def check_ready(
    steps: Sequence[Step], anew: Iterable[Resource], placed: Placed, instance: str, snapshot: Snapshot, look: Gathering,
    *, playbooks: bool,
) -> tuple[tuple[str, ...], Leads]:  # fmt: skip
    """Ask the robots of new containers for what those need of them; return what is worth a note, and where paths lead.

    A folder that a playbook of the user's may make, which would run before, is only noted. Of `anew` each trial makes
    the containers that are not kept, also where one is there.

    Raises:
        UsageError: A folder is not there, or leads to what is graver to mount, or a port is somebody else's; names all.
    """
    new = _new_services(steps, anew, placed.experiment)
    answers = look.ask_each({robot: (*asked_of(services), *QUERIES) for robot, services in new.items()})
    replies = of_those_that_told(answers)  # ports are known in any case
    now = replace(snapshot, taken={robot: taken_ports(said[ASKED:]) for robot, said in answers.items()})
    held = holders({}, {}, of_others(now, instance, placed.experiment, placed.previous))
    missing = [line for robot, said in replies.items() for line in missing_folders(robot, new[robot], said[0])]
    taken = [
        f"{robot}: {lack.text}, and '{service.name}' would have it"
        for robot, services in new.items()
        for service in services
        for lack in missing_ports(service, robot, held)
    ]
    led = [one for robot, said in replies.items() for one in led_elsewhere(robot, new[robot], said[0])]
    grave = [f"{line}: mount that, which asks for {GRAVE}" for line, is_grave in led if is_grave]
    wrong = [*grave, *taken] if playbooks else [*missing, *grave, *taken]
    if wrong:
        hint = "make the folder there, let it be made (bind: {create_host_path: true}), or publish another port"
        raise UsageError(
            "robots are not ready for the new containers:\n" + "\n".join(wrong), hint=hint, code=Code.NO_ROOM
        )
    absent = (f"{line}, unless a playbook makes it" for line in missing)
    return (*absent, *told(new, replies, snapshot, instance)), leads_of(new, answers)


def with_log_drivers(steps: Iterable[Step], snapshot: Snapshot, look: Gathering) -> Snapshot:
    """Return the snapshot with the default log driver of every engine that gets a new container.

    Asks those of which it is not known; where there is none, the snapshot is returned itself.
    """
    docker = {robot: facts.docker for robot, facts in snapshot.facts.items() if facts.docker}
    hosts = {step.host for step in steps if step.module in RUNNING and step.want and step.change.action in _NEW}
    unknown = sorted(host for host in hosts if host in docker and not docker[host].log_driver)
    replies = look.ask_each({host: (INFO,) for host in unknown})
    facts = dict(snapshot.facts)
    for host, (reply,) in replies.items():
        driver = text(mapping(reply.json()).get("LoggingDriver"), length=64) if reply.ok else ""
        facts[host] = replace(facts[host], docker=replace(docker[host], log_driver=driver))
    return replace(snapshot, facts=facts) if replies else snapshot


def _new_services(steps: Iterable[Step], anew: Iterable[Resource], experiment: Experiment) -> dict[str, list[Service]]:
    """Return robot -> services with folders, ports or devices of its own whose container is made or started there."""
    made = [one.want for one in steps if one.want and one.change.action in STARTING]
    kept = experiment.trials.settings.keep if experiment.trials else ()
    every = (*made, *(one for one in anew if one.service not in kept))
    found: dict[str, list[Service]] = {}
    for host, name in dict.fromkeys((one.host, one.service) for one in every if one.module in RUNNING):
        service = experiment.services.get(name)
        if service and (declared(service) or any(binds(service)) or service.runtime.devices):
            found.setdefault(host, []).append(service)
    return found
