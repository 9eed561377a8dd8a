"""Where the devices of new containers really are, as an engine follows links to them.

A plan says of devices by their names what they give away, and a robot's own rules give any device another name:
`/dev/lidar`, or `/dev/ubuntu-vg/root` of a disk. The robot says where these lead, and which are disks: kernels have
more kinds of them than any list.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from srprov.definitions.model import Service
from srprov.modules.mount_kind import plain
from srprov.planning.graver import A_DISK, HARMLESS, of_device
from srprov.untrusted import absolute, lines_of, text
from srprov.wire import Query, quote

_MOST_LINES = 100_000
"""Of one answer: a service has at most 1000 mounts."""
_ANY = "it may be any device"


def where_they_lead(services: Iterable[Service]) -> Query:
    """Ask where the devices lead, each by its number; behind a `b` those again that are disks, or folders with some."""
    tests = [
        f'r=$(readlink -f {quote(path)}) && printf "%s %s\\n" {number} "$r" && '
        f'[ -n "$(find "$r" -maxdepth 3 -type b 2>/dev/null)" ] && printf "b%s %s\\n" {number} "$r"'
        for number, path in enumerate(_users(services))
    ]
    return Query(command="\n".join([*tests, ":"]))


def led_to(said: str) -> dict[str, str]:
    """Return number, as it was asked by -> where that leads, by what a robot says; an answer that is no path is ""."""
    return {number: absolute(path) for number, _, path in (line.partition(" ") for line in lines_of(said, _MOST_LINES))}


def graver_devices(services: Iterable[Service], said: str) -> Iterator[str]:
    """Yield a sentence for each device that is more than its name says, by what a robot says of where it is."""
    users = _users(services)
    led = led_to(said)
    for number, (path, names) in enumerate(users.items()):
        real = led.get(str(number), "")
        told = of_device(plain(path))
        if not real or told == A_DISK:
            continue  # it is not there, or that was said
        note = (of_device(plain(real)) if real.startswith("/dev/") else _ANY) if real != path else ""
        disk = f"is, or holds, {A_DISK}"
        note = f"it {disk}" if f"b{number}" in led else note or (HARMLESS if told and real != path else "")
        if note:
            what = disk if real == path else f"leads to {text(real)} ({note})"
            yield f"the device {path}, which {' and '.join(names)} has, {what}"


def _users(services: Iterable[Service]) -> dict[str, list[str]]:
    """Return device -> in words whose containers have it, sorted."""
    found: dict[str, dict[str, None]] = {}
    for service in services:
        for path, _, _ in service.runtime.devices:
            found.setdefault(path, {})[f"'{service.name}'"] = None
    return {path: list(names) for path, names in sorted(found.items())}
