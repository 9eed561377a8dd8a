"""What robots must have and have not for containers that are new: folders that services mount, and free ports.

Docker would say so too, in the middle of a run; here it is a clear error of the plan. Asks only robots that get such a
container, in one round trip; with nothing new it asks nobody.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Protocol

from msgspec.structs import replace

from srprov.assignment.ports import declared, holders, missing_ports
from srprov.assignment.requirements import kernel_fits
from srprov.codes import Code
from srprov.controller.device_links import graver_devices, where_they_lead
from srprov.controller.other_names import USED, other_names, used
from srprov.controller.robot_mounts import MOUNTS, Mounts
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Experiment, Service
from srprov.errors import UsageError
from srprov.facts.gather import Gathering
from srprov.facts.model import HostFacts, Snapshot, TakenPort
from srprov.facts.probes import INFO
from srprov.facts.taken import QUERIES, taken_ports
from srprov.modules import RUNNING
from srprov.modules.mount_kind import GRAVE, gives_away, mount_kind, plain, written_by
from srprov.planning.plan import Step
from srprov.resource import Action
from srprov.robot_answers import TooManyError
from srprov.untrusted import folder, integer, lines_of, mapping, text
from srprov.wire import Query, Reply, quote

_NEW = (Action.CREATE, Action.REPLACE)
_RECURSIVE_API, _RECURSIVE_KERNEL = "1.44", "5.12"
"""From Docker 25 and Linux 5.12 on, all that is mounted below a path is read-only with it."""
_MOST_NAMED = 4
_MOST_LINES = 100_000
"""Of one answer: a service has at most 1000 mounts."""


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
    steps: Sequence[Step], placed: Placed, instance: str, snapshot: Snapshot, look: Gathering, *, playbooks: bool
) -> tuple[str, ...]:  # fmt: skip
    """Ask the robots of new containers for what those need of them; return what is worth a note.

    A folder that a playbook of the user's may make, which would run before, is only noted.

    Raises:
        UsageError: A folder is not there, or leads to what is graver to mount, or a port is somebody else's; names all.
    """
    new = _new_services(steps, placed.experiment)
    asked = (MOUNTS, USED, *QUERIES)
    replies = look.ask_each({robot: (_folders(some), *asked, where_they_lead(some)) for robot, some in new.items()})
    now = replace(snapshot, taken={robot: taken_ports(said[3:-1]) for robot, said in replies.items()})
    held = holders({}, {}, of_others(now, instance, placed.experiment, placed.previous))
    missing = [line for robot, said in replies.items() for line in _missing(robot, new[robot], said[0])]
    taken = [
        f"{robot}: {lack.text}, and '{service.name}' would have it"
        for robot, services in new.items()
        for service in services
        for lack in missing_ports(service, robot, held)
    ]
    led = [one for robot, said in replies.items() for one in _led(robot, new[robot], said[0])]
    grave = [f"{line}: mount that, which asks for {GRAVE}" for line, is_grave in led if is_grave]
    wrong = [*grave, *taken] if playbooks else [*missing, *grave, *taken]
    if wrong:
        hint = "make the folder there, let it be made (bind: {create_host_path: true}), or publish another port"
        raise UsageError(
            "robots are not ready for the new containers:\n" + "\n".join(wrong), hint=hint, code=Code.NO_ROOM
        )
    open_ones = [
        line for robot, said in replies.items() for line in _still_writable(snapshot.facts[robot], new[robot], said)
    ]
    others = [f"{robot}: {line}" for robot, said in replies.items() for line in _otherwise(new[robot], said)]
    others += [f"{one}: {line}" for one, said in replies.items() for line in graver_devices(new[one], said[-1].out)]
    absent = (f"{line}, unless a playbook makes it" for line in missing)
    return (*absent, *(line for line, _ in led), *open_ones, *others)


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


def _new_services(steps: Iterable[Step], experiment: Experiment) -> dict[str, list[Service]]:
    """Return robot -> services that get a container there with folders, ports or devices of the robot's."""
    found: dict[str, list[Service]] = {}
    for step in steps:
        service = experiment.services.get(step.service)
        new = step.module in RUNNING and step.want and step.change.action in _NEW
        if new and service and (declared(service) or any(_binds(service)) or service.runtime.devices):
            found.setdefault(step.host, []).append(service)
    return found


def _binds(service: Service) -> Iterator[Mount]:
    return (mount for mount in service.runtime.mounts if mount.kind == "bind")


def _all_sources(services: Iterable[Service]) -> list[str]:
    return sorted({mount.source for service in services for mount in _binds(service)})


def _folders(services: Iterable[Service]) -> Query:
    """Ask for the numbers of those sources that are not there, and where those lead that have a link in them."""
    tests = [
        f"[ -e {quote(source)} ] || echo {number}\n"
        f'r=$(readlink -f {quote(source)}) && [ "$r" != {quote(source)} ] && printf "%s %s\\n" {number} "$r"'
        for number, source in enumerate(_all_sources(services))
    ]
    return Query(command="\n".join([*tests, ":"]))


def _leads(services: Iterable[Service], reply: Reply) -> dict[str, str]:
    """Return source -> where it really is, by the reply to `_folders`."""
    said = dict(line.partition(" ")[::2] for line in lines_of(reply.out, _MOST_LINES))
    return {source: folder(said.get(str(number), "")) or source for number, source in enumerate(_all_sources(services))}


def _missing(robot: str, services: Sequence[Service], reply: Reply) -> Iterator[str]:
    numbers, users = {line.strip() for line in reply.out.splitlines()}, _users(services, made=False)
    for number, source in enumerate(_all_sources(services)):
        if str(number) in numbers and source in users:
            yield f"{robot}: {source}, which {users[source]} mounts, does not exist"


def _led(robot: str, services: Sequence[Service], reply: Reply) -> Iterator[tuple[str, bool]]:
    """Yield a line for each source that a link leads elsewhere, and whether that is graver to mount than it looks."""
    users, written = _users(services), _written(services)
    for source, real in _leads(services, reply).items():
        if plain(real) != plain(source):
            kind, why = mount_kind(real, read_only=source not in written)
            note = f" ({why})" if why and kind != GRAVE else ""
            is_grave = kind == GRAVE != mount_kind(source)[0]
            yield f"{robot}: {source}, which {users[source]} mounts, leads to {real}{note}", is_grave


def _otherwise(services: Sequence[Service], said: Sequence[Reply]) -> Iterator[str]:
    """Yield a line for each source that is more than its name, and where a link leads, say."""
    users, written = _users(services), _written(services)
    paths = [
        (f"{source}, which {users[source]} mounts,", real, source not in written)
        for source, real in _leads(services, said[0]).items()
    ]
    if paths:
        yield from other_names(paths, Mounts(said[1].out), used(said[2].out))


def _still_writable(robot: HostFacts, services: Sequence[Service], said: Sequence[Reply]) -> Iterator[str]:
    """Yield a line for each source that is mounted read-only, and holds mounts that a container can write to."""
    api = robot.docker.api_version if robot.docker else ""
    if kernel_fits(f">={_RECURSIVE_API}", api) and kernel_fits(f">={_RECURSIVE_KERNEL}", robot.kernel):
        return
    only = {one.source: service.name for service in services for one in _binds(service) if one.read_only}
    mounts = Mounts(said[1].out if only else "")
    for source, real in _leads(services, said[0]).items():
        try:
            points = mounts.writable_below(real) if source in only else []
        except TooManyError as error:
            yield f"{robot.name}: {error}: whether all of {source} is read-only is not known"
            return
        if points:
            shown = ", ".join(map(text, points[:_MOST_NAMED])) + (" and more" if len(points) > _MOST_NAMED else "")
            what = f"{source} is read-only for '{only[source]}', but what is mounted below it is not"
            grave = any(why for _, why in map(mount_kind, points))
            yield f"{robot.name}: {what}: {shown}{f' ({gives_away(read_only=False)})' if grave else ''}"


def _written(services: Iterable[Service]) -> set[str]:
    """Return the sources that some container may write to."""
    return {path for service in services for path in written_by(service.runtime)}


def _users(services: Iterable[Service], *, made: bool = True) -> dict[str, str]:
    """Return source -> in words who mounts it; without `made`, who does not have it made where it is not there."""
    found: dict[str, dict[str, None]] = {}
    for service in services:
        for mount in _binds(service):
            if made or not mount.create_host_path:
                found.setdefault(mount.source, {})[f"'{service.name}'"] = None
    return {source: " and ".join(names) for source, names in found.items()}
