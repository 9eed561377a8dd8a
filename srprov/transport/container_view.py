"""Which folder of the robot a container sees at which path, by its engine's word and the robot's. Pure.

An engine before 29.5.1 that is asked for a container's files mounts all of its volumes, binds and its own `/etc/hosts`
into them first, among the robot's folders, and finds each place by name before: a container that swaps a folder for a
link meanwhile has them mounted anywhere on the robot (CVE-2026-41568 and CVE-2026-42306). So such an engine is not
asked while anybody can swap something; the folders are read without it.

Source: moby, `daemon/volumes_unix.go` and `container/container_unix.go`; tried with Docker 20.10.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable, Iterator, Mapping

import msgspec

from srprov.led import led_of, mounted_at
from srprov.sandbox import named
from srprov.transport.container_look import decoded, text_of
from srprov.transport.path_index import Folders
from srprov.untrusted import absolute, is_too_long, mapping, mappings, string
from srprov.wire import quote

_OWN_FILES = {"/etc/hosts": "HostsPath", "/etc/hostname": "HostnamePath", "/etc/resolv.conf": "ResolvConfPath"}
"""What an engine mounts into each container that was started, and what it calls that."""
_SRPROVS = ("/var/lib/srprov/", "/run/srprov/")
"""Below which srprov keeps what containers read alone: trees, data sets and secrets."""
_NO_ID = "\0"
_MOST_MOUNTED = 5000
_AT_REST = ("created", "exited", "dead")
_MOST_MOUNTS = 1000
"""Of a container: an EDF names no more, but images may."""
_LONGEST_MOUNTS = 1 << 20
"""Characters of all their paths."""
_REMAPPED = re.compile(r"/[0-9]+\.[0-9]+/containers/", re.ASCII)
"""Where an engine that remaps users keeps its containers."""


class Mount(msgspec.Struct, frozen=True, kw_only=True):
    """A volume, a bind or a file of the engine's own."""

    at: str
    source: str
    volume: str = ""
    writable: bool = True


class About(msgspec.Struct, frozen=True, kw_only=True):
    """What an engine says of a container."""

    running: bool
    id: str = ""
    mounts: tuple[Mount, ...] = ()
    merged: str = ""
    """Folder of the robot where its files lie while it runs, without what is mounted; or nothing."""
    read_only: bool = False
    remapped: bool = False
    """Its users have other numbers on the robot."""
    led: Mapping[str, str] = msgspec.field(default_factory=dict)
    """The robot's path -> where it led when the container was made; of others nothing is known."""
    too_many: bool = False
    """It has more mounts than are looked at, or longer ones; an engine lists them in any order: any may be there."""


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A folder of the robot that a container sees, or a file in one."""

    at: str
    root: str
    """Empty: there is none any more."""
    name: str = ""
    """Of the file."""
    writable: bool = True

    def on_robot(self, path: str) -> str:
        """Return where a path that lies in it is on the robot."""
        return f"{self.root.rstrip('/')}{path[len(self.at.rstrip('/')) :]}"

    def below(self, path: str) -> str:
        """Return what a path that lies in it is called in its root."""
        return self.name or path[len(self.at.rstrip("/")) :].lstrip("/") or "."

    def seen_at(self, path: str) -> str:
        """Return where the container sees a path of the robot that lies in it."""
        return f"{self.at.rstrip('/')}{path[len(self.root.rstrip('/')) :]}"


class View:
    """All that a container sees, as far as it can be read without its engine."""

    def __init__(self, parts: Iterable[Part], mounted: Folders) -> None:
        """Take its parts, of which the first one at a place counts, and what is mounted on the robot."""
        self.parts = tuple(parts)
        self._mounted = mounted
        self._at = {one.at: one for one in reversed(self.parts)}
        self._places = Folders(self._at)

    def of(self, parts: Iterable[Part]) -> View:
        """Return a view of other parts on the same robot."""
        return View(parts, self._mounted)

    def part_of(self, path: str) -> Part | None:
        """Return what a path lies in; None: in nothing that can be read."""
        best = next((self._at[one] for one in self._places.holding(path)), None)
        return None if best is None or not best.root or self.mounted_over(path, best.at) else best

    def mounted_over(self, path: str, above: str) -> str:
        """Return what is mounted below a folder, at a path or above that; or nothing."""
        over = [*self._places.holding(path), *self._robots_over(path)]
        return max((one for one in over if len(one) > len(above)), key=len, default="")

    def mounted_below(self, path: str) -> str:
        """Return what is mounted below a path, or nothing."""
        robots = (one.seen_at(hole) for one in self._folders(path) if (hole := self._mounted.below(one.on_robot(path))))
        return self._places.below(path) or next(robots, "")

    def _robots_over(self, path: str) -> Iterator[str]:
        """Yield what the robot itself has mounted in the folders that a path lies in, at the path or above that."""
        for one in self._folders(path):
            hole = next(self._mounted.holding(one.on_robot(path)), "")
            if len(hole) > len(one.root) and within(hole, one.root):
                yield one.seen_at(hole)

    def _folders(self, path: str) -> Iterator[Part]:
        parts = (self._at[one] for one in self._places.holding(path))
        return (one for one in parts if one.root and not one.name)


def within(path: str, above: str) -> bool:
    """Return whether a path is another one, or lies below it."""
    return path == above or path.startswith(f"{above.rstrip('/')}/")


def about(inspected: object) -> About:
    """Return what an engine says of a container."""
    found = mapping(inspected)
    every = mappings(found.get("Mounts"), most=_MOST_MOUNTS + 1)
    graph, paths = mapping(found.get("GraphDriver")), {at: absolute(found.get(key)) for at, key in _OWN_FILES.items()}
    mounts = [
        Mount(
            at=at,
            source=source,
            volume=string(one.get("Name")) if one.get("Type") == "volume" else "",
            writable=one.get("RW") is not False,
        )
        for one in every[:_MOST_MOUNTS]
        if (at := mounted_at(one)) and (source := absolute(one.get("Source")))
    ]
    taken = {one.at for one in mounts}
    mounts += [Mount(at=at, source=source) for at, source in paths.items() if source and at not in taken]
    return About(
        running=string(mapping(found.get("State")).get("Status")) not in _AT_REST,
        id=string(found.get("Id")) or _NO_ID,
        mounts=tuple(mounts),
        merged=absolute(mapping(graph.get("Data")).get("MergedDir")) if graph.get("Name") == "overlay2" else "",
        read_only=mapping(found.get("HostConfig")).get("ReadonlyRootfs") is True,
        remapped=any(_REMAPPED.search(path) for path in paths.values()),
        too_many=len(every) > _MOST_MOUNTS or _are_long(every),
        led=led_of(found),
    )


def _are_long(mounts: Iterable[Mapping[str, object]]) -> bool:
    paths = [string(one.get(key)) for one in mounts for key in ("Source", "Destination")]
    return sum(map(len, paths)) > _LONGEST_MOUNTS or any(map(is_too_long, paths))


def has_paths(one: About) -> bool:
    """Return whether a container has, or may have, a path of the robot's, of which nobody knows who else has it."""
    own = tuple(f"/containers/{one.id}/{posixpath.basename(at)}" for at in _OWN_FILES)
    given = [mount for mount in one.mounts if not (mount.source.startswith(_SRPROVS) or mount.source.endswith(own))]
    return one.too_many or not all(mount.volume for mount in given)


def sources_script(one: About) -> str:
    """Return the question where the paths of a container's mounts lead on its robot, and what is mounted there."""
    paths = " ".join(quote(path) for path in _sources(one))
    kind = 'if [ -d "$real" ]; then kind=d; elif [ -e "$real" ]; then kind=f; else kind=; fi'
    look = f'for one in {paths}; do real=$(realpath -e -- "$one" 2>/dev/null); {kind}; printf "%s%s\\0" "$kind" "$real"'
    return f"{{ {look}; done; cut -d ' ' -f 5 /proc/self/mountinfo; }} | base64 -w 0"


def _sources(one: About) -> list[str]:
    return [one.merged or "/", *(mount.source for mount in one.mounts)]


def view(one: About, said: str) -> View:
    """Return what a container sees, by what its robot answers; what is not there any more is left out.

    What leads elsewhere than when the container was made is not there: a link came in its way since.
    """
    *found, points = decoded(said).split(b"\0")
    mounted = {named(line) for line in points.splitlines()}
    if (
        len(found) != 1 + len(one.mounts)
        or len(mounted) > _MOST_MOUNTED
        or any(is_too_long(text_of(m)) for m in mounted)
    ):
        return View((), Folders())
    root = Mount(at="/", source=one.merged, writable=not one.read_only)
    there = one.merged and one.running and found[0][1:] in mounted
    parts = [
        _part(mount, real if text_of(real[1:]) == one.led.get(mount.source, text_of(real[1:])) else b"")
        for mount, real in zip((root, *one.mounts), found, strict=True)
    ]
    return View(parts if there else parts[1:], Folders(map(text_of, mounted)))


def _part(mount: Mount, real: bytes) -> Part:
    root = text_of(real[1:])
    if real[:1] == b"f":
        folder, name = posixpath.split(root)
        return Part(at=mount.at, root=folder, name=name, writable=False)
    return Part(at=mount.at, root=root if real[:1] else "", writable=mount.writable)
