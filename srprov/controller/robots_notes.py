"""What robots say of the folders and devices that new containers get: which are more than their names, for notes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from srprov.assignment.requirements import kernel_fits
from srprov.controller.device_links import graver_devices, led_to, where_they_lead
from srprov.controller.other_names import USED, other_names, used
from srprov.controller.robot_mounts import MOUNTS, Mounts
from srprov.controller.shared_folders import CONTAINERS, shared
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Service
from srprov.facts.gather import Gathering
from srprov.facts.model import HostFacts, Snapshot
from srprov.modules import MODULES, RUNNING
from srprov.modules.mount_kind import GRAVE, gives_away, mount_kind, plain, written_by
from srprov.modules.mount_place import LEADS_TO, NOT_TOLD
from srprov.planning.plan import Step
from srprov.resource import Action
from srprov.robot_answers import TooManyError
from srprov.untrusted import text
from srprov.wire import AnyQuery, Query, Reply, quote

ASKED = 5
"""Questions of `asked_of`."""
_RECURSIVE_API, _RECURSIVE_KERNEL = "1.44", "5.12"
"""From Docker 25 and Linux 5.12 on, all that is mounted below a path is read-only with it."""
_MOST_NAMED = 4


STARTING = (Action.CREATE, Action.REPLACE, Action.UPDATE)
"""Of a container: engines follow links also when they start one again."""
Leads = Mapping[str, Mapping[str, str]]
"""Robot -> path that a new container there mounts -> where that leads."""


def notes_of_robots(
    steps: Iterable[Step], snapshot: Snapshot, look: Gathering, instance: str
) -> tuple[tuple[str, ...], Leads]:
    """Return what robots say of the folders and devices that new containers get, where no EDF says what these are.

    Whoever wrote a plan file wrote the notes in it, too. Also returns where the folders lead.
    """
    new: dict[str, list[Service]] = {}
    for step in steps:
        is_new = step.module in RUNNING and step.change.action in STARTING
        if step.want and is_new and step.host in snapshot.facts:
            service = MODULES[step.module].service_of(step.name, step.want.params)
            if service and (any(binds(service)) or service.runtime.devices):
                new.setdefault(step.host, []).append(service)
    replies = look.ask_each({robot: asked_of(services) for robot, services in new.items()})
    return tuple(told(new, of_those_that_told(replies), snapshot, instance)), leads_of(new, replies)


def of_those_that_told(replies: Mapping[str, Sequence[Reply]]) -> dict[str, Sequence[Reply]]:
    """Return the replies to `asked_of` of robots that answered all of it; the engine's answer is looked at later."""
    return {robot: said for robot, said in replies.items() if all(one.ok for one in said[: ASKED - 1])}


def leads_of(new: Mapping[str, Sequence[Service]], replies: Mapping[str, Sequence[Reply]]) -> Leads:
    """Return where the folders of new services lead, by the replies to `asked_of`; of who did not tell: nowhere."""
    return {
        robot: _leads(some, replies[robot][0])
        if robot in replies and replies[robot][0].ok
        else dict.fromkeys(_all_sources(some), NOT_TOLD)
        for robot, some in new.items()
    }


def asked_of(services: Sequence[Service]) -> tuple[AnyQuery, ...]:
    """Return what is asked of the robot of new services."""
    return (_folders(services), MOUNTS, USED, where_they_lead(services), CONTAINERS)


def told(
    new: Mapping[str, Sequence[Service]], replies: Mapping[str, Sequence[Reply]], snapshot: Snapshot, instance: str
) -> Iterator[str]:
    """Yield a line for each folder or device that is more than its name, by the replies to `asked_of`.

    And for each robot that did not tell all of it. Where its folders lead is compared when containers are made.
    """
    for robot in sorted(new.keys() - replies.keys()):
        yield f"{robot}: it does not say what the folders and devices of its new containers are"
    for robot, said in replies.items():
        yield from (line for line, _ in led_elsewhere(robot, new[robot], said[0]))
    for robot, said in replies.items():
        yield from _still_writable(snapshot.facts[robot], new[robot], said)
    for robot, said in replies.items():
        yield from (f"{robot}: {line}" for line in _otherwise(new[robot], said))
    for robot, said in replies.items():
        yield from (f"{robot}: {line}" for line in _of_others(new[robot], said, instance))
    for robot, said in replies.items():
        yield from (f"{robot}: {line}" for line in graver_devices(new[robot], said[3].out))


def missing_folders(robot: str, services: Sequence[Service], reply: Reply) -> Iterator[str]:
    """Yield a line for each source that is not there, and that its service does not have made."""
    numbers, users = {line.strip() for line in reply.out.splitlines()}, _users(services, made=False)
    for number, source in enumerate(_all_sources(services)):
        if str(number) in numbers and source in users:
            yield f"{robot}: {source}, which {users[source]} mounts, does not exist"


def led_elsewhere(robot: str, services: Sequence[Service], reply: Reply) -> Iterator[tuple[str, bool]]:
    """Yield a line for each source that a link leads elsewhere, and whether that is graver to mount than it looks."""
    users, written = _users(services), _written(services)
    for source, real in _leads(services, reply).items():
        if plain(real) != plain(source):
            kind, why = mount_kind(real, read_only=source not in written)
            note = f" ({why})" if why and kind != GRAVE else ""
            is_grave = kind == GRAVE != mount_kind(source)[0]
            yield f"{robot}: {source}, which {users[source]} mounts, leads to {text(real)}{note}", is_grave


def _otherwise(services: Sequence[Service], said: Sequence[Reply]) -> Iterator[str]:
    """Yield a line for each source that is more than its name, and where a link leads, say."""
    users, written = _users(services), _written(services)
    paths = [
        (f"{source}, which {users[source]} mounts,", real, source not in written)
        for source, real in _leads(services, said[0]).items()
    ]
    if paths:
        yield from other_names(paths, Mounts(said[1].out), used(said[2].out))


def _of_others(services: Sequence[Service], said: Sequence[Reply], instance: str) -> Iterator[str]:
    """Yield a line for each source that containers of others have."""
    users, written = _users(services), _written(services)
    leads = _leads(services, said[0]).items()
    paths = [(f"{one}, which {users[one]} mounts,", one in written, (one, real)) for one, real in leads]
    yield from shared(paths, said[4], instance)


def _still_writable(robot: HostFacts, services: Sequence[Service], said: Sequence[Reply]) -> Iterator[str]:
    """Yield a line for each source that is mounted read-only, and holds mounts that a container can write to."""
    api = robot.docker.api_version if robot.docker else ""
    if kernel_fits(f">={_RECURSIVE_API}", api) and kernel_fits(f">={_RECURSIVE_KERNEL}", robot.kernel):
        return
    only = {one.source: service.name for service in services for one in binds(service) if one.read_only}
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


def binds(service: Service) -> Iterator[Mount]:
    """Return the mounts of the robot's folders."""
    return (mount for mount in service.runtime.mounts if mount.kind == "bind")


def _all_sources(services: Iterable[Service]) -> list[str]:
    return sorted({mount.source for service in services for mount in binds(service)})


def _folders(services: Iterable[Service]) -> Query:
    """Ask for the numbers of those sources that are not there, and where those lead that have a link in them."""
    tests = [
        f"[ -e {quote(source)} ] || echo {number}\n"
        f'r=$(leads_to {quote(source)}) && [ "$r" != {quote(source)} ] && printf "%s %s\\n" {number} "$r"'
        for number, source in enumerate(_all_sources(services))
    ]
    return Query(command="\n".join([LEADS_TO, *tests, ":"]))


def _leads(services: Iterable[Service], reply: Reply) -> dict[str, str]:
    """Return source -> where it really is, by the reply to `_folders`."""
    said = led_to(reply.out)
    return {source: said.get(str(number)) or source for number, source in enumerate(_all_sources(services))}


def _written(services: Iterable[Service]) -> set[str]:
    """Return the sources that some container may write to."""
    return {path for service in services for path in written_by(service.runtime)}


def _users(services: Iterable[Service], *, made: bool = True) -> dict[str, str]:
    """Return source -> in words who mounts it; without `made`, who does not have it made where it is not there."""
    found: dict[str, dict[str, None]] = {}
    for service in services:
        for mount in binds(service):
            if made or not mount.create_host_path:
                found.setdefault(mount.source, {})[f"'{service.name}'"] = None
    return {source: " and ".join(names) for source, names in found.items()}
