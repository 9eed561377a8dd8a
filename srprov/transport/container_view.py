"""Which folder of the robot a container sees at which path, by its engine's word and the robot's. Pure.

An engine before 29.5.1 that is asked for a container's files mounts all of its volumes, binds and its own `/etc/hosts`
into them first, among the robot's folders, and finds each place by name before: a container that swaps a folder for a
link meanwhile has them mounted anywhere on the robot (CVE-2026-41568 and CVE-2026-42306). So such an engine is not
asked while anybody can swap something; the folders are read without it.

Source: moby, `daemon/volumes_unix.go` and `container/container_unix.go`; tried with Docker 20.10.
"""

from __future__ import annotations

import base64
import binascii
import posixpath
import re
from collections.abc import Mapping, Sequence

import msgspec

from srprov.led import led_of
from srprov.sandbox import named
from srprov.untrusted import absolute, mapping, mappings, string
from srprov.wire import quote

_OWN_FILES = {"/etc/hosts": "HostsPath", "/etc/hostname": "HostnamePath", "/etc/resolv.conf": "ResolvConfPath"}
"""What an engine mounts into each container that was started, and what it calls that."""
_SRPROVS = ("/var/lib/srprov/", "/run/srprov/")
"""Below which srprov keeps what containers read alone: trees, data sets and secrets."""
_NO_ID = "\0"
_LONGEST_LINK = 4096
"""Bytes that Linux takes."""
_MOST_MOUNTED = 5000
_AT_REST = ("created", "exited", "dead")
_MOST_MOUNTS = 1000
"""Of a container: an EDF names no more, but images may."""
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
    """It has more mounts than are looked at, which an engine lists in any order: none is known not to be there."""


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A folder of the robot that a container sees, or a file in one."""

    at: str
    root: str
    """Empty: there is none any more."""
    name: str = ""
    """Of the file."""
    writable: bool = True
    holes: tuple[str, ...] = ()
    """Where the robot has something else mounted below, relative to it."""


class View(msgspec.Struct, frozen=True):
    """All that a container sees, as far as it can be read without its engine."""

    parts: tuple[Part, ...]

    def part_of(self, path: str) -> Part | None:
        """Return what a path lies in; None: in nothing that can be read."""
        best = max((one for one in self.parts if within(path, one.at)), key=lambda one: len(one.at), default=None)
        return None if best is None or not best.root or self.mounted_over(path, best.at) else best

    def mounted_over(self, path: str, above: str) -> str:
        """Return what is mounted below a folder, at a path or above that; or nothing."""
        over = (one for one in self._places() if len(one) > len(above) and within(path, one))
        return max(over, key=len, default="")

    def mounted_below(self, path: str) -> str:
        """Return what is mounted below a path, or nothing."""
        return next((one for one in self._places() if one != path and within(one, path)), "")

    def _places(self) -> list[str]:
        holes = [posixpath.join(one.at, hole) for one in self.parts for hole in one.holes]
        return [*(one.at for one in self.parts), *holes]


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
            at=posixpath.normpath(at),
            source=source,
            volume=string(one.get("Name")) if one.get("Type") == "volume" else "",
            writable=one.get("RW") is not False,
        )
        for one in every[:_MOST_MOUNTS]
        if (at := _place(string(one.get("Destination")))) and (source := absolute(one.get("Source")))
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
        too_many=len(every) > _MOST_MOUNTS,
        led=led_of(found),
    )


def _place(destination: str) -> str:
    """Return where something is mounted: what an image names without a slash is below the root all the same."""
    return absolute(posixpath.join("/", destination)) if destination else ""


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
    mounted = [named(line) for line in points.splitlines()]
    if len(found) != 1 + len(one.mounts) or len(mounted) > _MOST_MOUNTED:
        return View(())
    root = Mount(at="/", source=one.merged, writable=not one.read_only)
    there = one.merged and one.running and found[0][1:] in mounted
    parts = [
        _part(mount, real if text_of(real[1:]) == one.led.get(mount.source, text_of(real[1:])) else b"", mounted)
        for mount, real in zip((root, *one.mounts), found, strict=True)
    ]
    return View(tuple(parts if there else parts[1:]))


def _part(mount: Mount, real: bytes, mounted: Sequence[bytes]) -> Part:
    kind, path = real[:1], real[1:]
    root, above = text_of(path), path.rstrip(b"/") + b"/"
    if kind == b"f":
        folder, name = posixpath.split(root)
        return Part(at=mount.at, root=folder, name=name, writable=False)
    holes = tuple(text_of(one[len(above) :]) for one in mounted if one.startswith(above) and one != above)
    return Part(at=mount.at, root=root, writable=mount.writable, holes=holes if kind else ())


class Found(msgspec.Struct, frozen=True):
    """What is at a path."""

    kind: str
    """As `find` says it: f, d, l and others."""
    size: int = 0
    link: str = ""


def look_script(names: Sequence[str]) -> str:
    """Return the question what is at paths below where one is; it follows no link at the end of one."""
    words = " ".join(quote(one) for one in names)
    return f"find {words} -prune -printf '%p\\0%y %s\\0%l\\0' 2>/dev/null | base64 -w 0"


def looked(said: str) -> Mapping[str, Found]:
    """Return path -> what is there, by what a robot answers to that."""
    words, found = decoded(said).split(b"\0"), dict[str, Found]()
    for name, about_it, link in zip(words[::3], words[1::3], words[2::3], strict=False):
        kind, _, size = about_it.decode("ascii", "replace").partition(" ")
        if kind and len(link) <= _LONGEST_LINK:
            found[text_of(name)] = Found(kind, int(size[:18]) if size.isdecimal() else 0, text_of(link))
    return found


def decoded(said: str) -> bytes:
    """Return the bytes that a robot says in letters, as names may be any bytes; nothing when it says something else."""
    try:
        return base64.b64decode(said.strip(), validate=True)
    except (binascii.Error, ValueError):
        return b""


def text_of(name: bytes) -> str:
    """Return a name as Python has those of files."""
    return name.decode("utf-8", "surrogateescape")
