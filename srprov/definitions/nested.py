"""Mounts below a volume that another service may write to: that one decides by a link where in the container they go.

An engine follows links in what is mounted already. With `data:/data` and `logs:/data/logs`, a link `logs` in the data
has the second volume mounted over `/usr/local/bin`, say, and what lies there is run with all that the service has. The
engine looks each time that it starts the container, so only who may write there can be decided once. Takes services;
gives what lies so, or adds to `Findings`. Pure.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

import msgspec

from srprov.codes import Code
from srprov.definitions import sharing
from srprov.definitions.model import Service
from srprov.definitions.secrets import target_of
from srprov.definitions.values import text
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq

_ITSELF = MappingProxyType({
    "/etc/hosts": "srprov", "/etc/srprov/": "srprov", "/dev/mqueue": "the engine", "/dev/pts": "the engine",
    "/dev/shm": "the engine", "/etc/hostname": "the engine", "/etc/resolv.conf": "the engine",  # noqa: S108
    "/sbin/docker-init": "the engine", "/sys/fs/cgroup": "the engine",
})  # fmt: skip
"""What may be mounted in any container, and stands in no definition -> who mounts it."""
_FIELDS = ("volumes", "tmpfs", "data", "devices", "secrets")


class Nested(msgspec.Struct, frozen=True, kw_only=True):
    """One mount, or device, that a link in a volume may lead elsewhere."""

    service: str
    place: str
    """Where it is mounted."""
    above: str
    """Where the volume is mounted that this lies in."""
    volume: str
    writer: str
    """Another service, which may write to the volume."""

    @property
    def words(self) -> str:
        """Return what is wrong, for the user."""
        whose = f", where {_ITSELF[self.place]} itself mounts something," if self.place in _ITSELF else ""
        return (
            f"'{self.place.rstrip('/')}'{whose} lies in the volume '{self.volume}', which '{self.writer}' may write to:"
            f" a link there would have it mounted elsewhere in '{self.service}', such as over its programs"
        )


def nested(services: Mapping[str, Service]) -> Iterator[Nested]:
    """Yield each mount that lies below a volume which another one of the services may write to."""
    writers: dict[str, list[str]] = {}
    for name, one in sorted(services.items()):
        for volume in sharing.written(one):
            writers.setdefault(volume, []).append(name)
    for name, one in services.items():
        shared = {
            _plain(mount.target): (mount.source, other)
            for mount in one.runtime.mounts
            if mount.kind == "volume"
            and (other := next((who for who in writers.get(mount.source, ()) if who != name), ""))
        }
        for place, above in _below(_places(one), shared) if shared else ():
            yield Nested(service=name, place=place, above=above, volume=shared[above][0], writer=shared[above][1])


def check(known: Mapping[str, Map], services: Mapping[str, Service], findings: Findings) -> None:
    """Add every such mount, at its line; what the EDF does not name, at the line of the volume or of the service."""
    for one in nested(services):
        entry = known[one.service]
        field, place = _written(entry, one.place) or _written(entry, one.above) or ("volumes", entry)
        other = f"/{posixpath.basename(one.place)}"
        if one.place in _ITSELF:
            what = "mount the volume elsewhere"
        else:
            what = f"mount it elsewhere, such as at '{other}'" if other != one.above else "mount it elsewhere"
        hint = f"{what}; or mount the volume read-only (`:ro`) in '{one.writer}'; or give each a volume of its own"
        findings.add(place, one.words, ("services", one.service, field), hint, code=Code.VOLUME)


def _places(one: Service) -> set[str]:
    targets = (mount.target for mount in one.runtime.mounts)
    others = (*(use.target for use in one.secrets), *(inside for _, inside, _ in one.runtime.devices))
    return {*map(_plain, (*targets, *others)), *_ITSELF}


def _plain(target: str) -> str:
    """Return a path in a container in one spelling; `/var/run` is a link to `/run` in most images."""
    path = "/" + posixpath.normpath(f"/{target}").lstrip("/")
    return path.removeprefix("/var") if f"{path}/".startswith("/var/run/") else path


def _below(places: Iterable[str], shared: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Yield each place below a shared volume, with the highest such one; of what stands in no definition the first."""
    above, told = "", False
    # a folder sorts right before all that is below it
    for place in sorted(places, key=lambda one: one.replace("/", "\0")):
        if above and place.startswith(f"{above}/"):
            if not (told and place in _ITSELF):
                yield place, above
            told = told or place in _ITSELF
        elif place in shared:
            above, told = place, False


def _written(entry: Map, place: str) -> tuple[str, Node] | None:
    """Return where an entry of the EDF says that something is mounted at a place, and by which field."""
    for field in _FIELDS:
        given = entry.entries.get(field)
        for item in given.items if isinstance(given, Seq) else (given,) if isinstance(given, Scalar) else ():
            if _plain(_target(field, item)) == place:
                return field, item
    return None


def _target(field: str, item: Node) -> str:
    if field == "secrets":
        return target_of(item)
    if isinstance(item, Map):
        return text(item.entries.get("target"))
    parts = text(item).split(":")
    return parts[0] if field == "tmpfs" or len(parts) == 1 else parts[1]
