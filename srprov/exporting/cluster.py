"""What engines that start containers on several machines are told alike: names, images, levels, files. Pure.

They give addresses when containers start, so services are told of each other by name; and none of them carries
multicast, so what finds its peers by it is told of them.
"""

from __future__ import annotations

import errno
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.definitions.containermodel import Mount, Runtime
from srprov.definitions.model import Experiment, Service
from srprov.exporting.images import Built, image_name
from srprov.exporting.model import ADAPTED, REFUSED, File, Machine, Path, Remark
from srprov.exporting.wanted import Wanted
from srprov.network.discovery import Discovery, discovery_of
from srprov.network.layout import ON_OVERLAY
from srprov.network.model import Overlay

_PLAIN = Runtime()


class Shipped(msgspec.Struct, frozen=True, kw_only=True):
    """One file that containers find at a path."""

    target: str
    content: bytes
    mode: int


_TMPFS_SIZE = re.compile(r"(?:.*,)?size=([0-9]{1,18})([kmgKMG]?)(?:,.*)?")


class CannotShip(Exception):
    """A mount that the engine has no place for; says why."""


def tmpfs_size(mount: Mount) -> tuple[int, str] | None:
    """Return the size of a tmpfs as a number and one of `k`, `m`, `g` or nothing; None where it has none in bytes."""
    found = _TMPFS_SIZE.fullmatch(mount.options)
    return (int(found[1]), found[2].lower()) if found else None


def machines(placed: Mapping[str, str], file: str) -> tuple[Machine, ...]:
    """Return who runs what; one `file` starts it all."""
    return tuple(
        Machine(
            robot=robot, services=tuple(sorted(name for name, at in placed.items() if at == robot)),
            file=file, shares_folder=True,
        )
        for robot in sorted(set(placed.values()))
    )  # fmt: skip


def by_name(experiment: Experiment) -> tuple[Experiment, Overlay]:
    """Return the experiment as such an engine runs it, and an overlay on which each service's address is its name."""
    services = experiment.services.values()
    names = {one.name: one.name for one in services if one.network in ON_OVERLAY}
    aliases: dict[str, list[str]] = {}
    for one in services:
        if one.instance_of and one.name in names:
            aliases.setdefault(one.instance_of, []).append(one.name)
    settings = experiment.network
    if settings.discovery == "multicast":
        settings = replace(settings, discovery="static-peers")
    overlay = Overlay(
        instance=experiment.name, underlays={}, names=names, addresses=names,
        aliases={name: tuple(some) for name, some in aliases.items()},
    )  # fmt: skip
    return replace(experiment, network=settings), overlay


def discovery(experiment: Experiment, overlay: Overlay, service: Service) -> Discovery:
    """Return what a service gets for its discovery, with names for addresses; ROS 1 has a variable of its own then."""
    found = discovery_of(experiment, overlay, service)
    environment = {
        "ROS_HOSTNAME" if name == "ROS_IP" else name: value
        for name, value in {**found.made_with, **found.environment}.items()
    }
    return Discovery(environment=environment, files=found.files)


def discovery_remarks(experiment: Experiment) -> Iterator[Remark]:
    """Yield what becomes of `network.discovery`."""
    if any(one.network in ON_OVERLAY for one in experiment.services.values()):
        words = "variables and files of the services, with names for addresses"
        if experiment.network.discovery == "multicast":
            words = f"as static-peers, since there is no multicast: {words}"
        yield Remark(path=("network", "discovery"), kind=ADAPTED, words=words)


def levels(services: Mapping[str, Service]) -> tuple[tuple[str, ...], ...]:
    """Return the services in groups: each waits for none but those of earlier groups. Definitions have no circle."""
    found: list[tuple[str, ...]] = []
    left = set(services)
    while left:
        ready = sorted(name for name in left if left.isdisjoint(services[name].depends_on))
        found.append(tuple(ready))
        left -= set(ready)
    return tuple(found)


def image_names(experiment: Experiment, built: Mapping[str, Built]) -> dict[str, str]:
    """Return CDF's key -> the name of its image."""
    return {key: image_name(experiment.name, one.name, one) for key, one in built.items()}


def builds(built: Mapping[str, Built]) -> Iterator[File]:
    """Yield the folders that images are built from."""
    for one in built.values():
        for file in one.files:
            yield replace(file, path=f"build/{one.name}/{file.path}")


def remark(service: Service, field: str, kind: str, words: str = "") -> Remark:
    """Return what is to be said of a field of a service."""
    path: Path = ("services", service.instance_of or service.name, field)
    return Remark(path=path, kind=kind, words=words)


def refusals(service: Service, fields: Mapping[str, str]) -> Iterator[Remark]:
    """Yield a refusal for each of these fields of the runtime that the service uses, with the table's words."""
    for field, words in fields.items():
        if getattr(service.runtime, field) != getattr(_PLAIN, field):
            yield remark(service, field, REFUSED, words)


def empty_words(service: Service) -> Iterator[Remark]:
    """Yield a refusal where the image's command or entrypoint is taken away: an empty list is the image's own there."""
    for field in ("command", "entrypoint"):
        if getattr(service.runtime, field) == ():
            yield remark(service, field, REFUSED, "an empty list would be the image's own")


def field_of(mount: Mount) -> str:
    """Return the field of a service that says this mount."""
    return "data" if mount.kind == "data" else "volumes"


def shipped(wanted: Wanted, mount: Mount, limit: int, what: str) -> tuple[Shipped, ...]:
    """Return the files of a shipped mount, each at its path in the container.

    Args:
        wanted: How files are read.
        mount: A `tree` or a data set.
        limit: Bytes that one file may have.
        what: What holds a file, for the message.

    Raises:
        CannotShip: A file is larger, is a link, or is not on the controller; or a folder is empty.
    """
    if mount.url:
        raise CannotShip(f"{what} holds no file that is downloaded")
    try:
        members = wanted.shipped(mount.source)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise CannotShip(f"a file is too large for {what}") from error
        raise CannotShip(f"{error.filename or mount.source} cannot be read: {error.strerror}") from error
    if any(one.link is not None for one in members):
        raise CannotShip(f"{what} holds no links")
    files = [one for one in members if not one.is_folder]
    if not files:
        raise CannotShip(f"{what} holds no empty folder")
    if large := next((one for one in files if len(one.content or b"") > limit), None):
        raise CannotShip(f"{large.path} is larger than the {limit // 1000} kB that {what} holds")
    return tuple(
        Shipped(
            target=posixpath.join(mount.target, *one.path.split("/")[1:]),
            content=one.content or b"",
            mode=one.mode & 0o777,
        )
        for one in files
    )


def open_names(wanted: Wanted, services: Sequence[Service]) -> tuple[str, ...]:
    """Return the variables of whoever starts it that services take, in name order."""
    values = (value for one in services for value in one.runtime.environment.values())
    return tuple(sorted({name for value in values if (name := wanted.open.stands_for(value))}))
