"""Paths of a robot that a container of an experiment may write to, by whatever names they are mounted.

What lies below such a folder is whatever that container wants: a link to the engine, too. Policies compare paths as
they are written, and a robot has further names for them: `/var/lock` is a link to `/run/lock`, a folder may be mounted
twice, or a part of it. So the robots of new containers are asked, where one writes to a path and another mounts a
second one.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence

import msgspec

from srprov.codes import Code
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Service
from srprov.errors import UsageError
from srprov.facts.gather import Gathering
from srprov.modules import RUNNING
from srprov.modules.mount_kind import GRAVE, below, mount_kind
from srprov.planning.plan import Step
from srprov.untrusted import lines_of, text
from srprov.wire import Query, quote

_MOST_LINES = 100_000
_MOUNTS = Query(command="cat /proc/self/mountinfo")
_MOUNT = re.compile(r"[0-9]+ [0-9]+ ([0-9]+:[0-9]+) (/\S*) (/\S*) .*", re.ASCII)
"""File system, the place in it that is mounted, and where; source: proc(5)."""
_OCTAL = re.compile(r"\\([0-7]{3})")
_NEWLINE = "newline='\n'"
_LOOK = r"""s=PATH p=$s
while [ -n "$p" ] && [ ! -e "$p" ]; do p=${p%/*}; done
r=$(readlink -f "${p:-/}")
[ -n "$r" ] || s=$p
case $r in *"$newline"*) s=$p r= ;; esac
printf '%s %s\n' NUMBER "${r%/}${s#"$p"}"
set --
while [ -n "${r%/}" ]; do set -- "$@" "$r"; r=${r%/*}; done
[ $# = 0 ] || stat -c '%d:%i' "$@" 2>/dev/null"""
"""Print a path's number and what it really is, then device and inode of what is there of it, from its end to the first
folder below /. A name of several lines is that of no path, and so is what cannot be told."""


class _Place(msgspec.Struct, frozen=True):
    """What a robot says of a path."""

    real: str
    folders: frozenset[str]
    """Device and inode of it and of those above, as far as it is there."""
    own: str
    """Its own; empty: it is not there."""


class _Mounts:
    """What is mounted on a robot, by its own word: one folder may be shown at several places, or a part of it."""

    def __init__(self, said: str) -> None:
        found = [match.groups() for line in lines_of(said, _MOST_LINES) if (match := _MOUNT.fullmatch(line))]
        self._all = [(point.rstrip("/") + "/", fs, root.rstrip("/")) for fs, root, point in (map(_plain, found))]

    def place(self, real: str) -> str:
        """Return the file system of a path, and its place in that, with a slash at its end."""
        within = [one for one in self._all if f"{real}/".startswith(one[0])]
        if not within:
            return ""
        point, fs, root = max(reversed(within), key=lambda one: len(one[0]))
        return f"{fs} {root}/{real[len(point) :].strip('/')}/".replace("//", "/")

    def shown(self, real: str) -> set[str]:
        """Return the places of a folder, and of all that is mounted below it."""
        below = [f"{fs} {root}/" for point, fs, root in self._all if point.startswith(f"{real.rstrip('/')}/")]
        return {self.place(real), *below} - {""}


def _plain(words: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(_OCTAL.sub(lambda match: chr(int(match[1], 8)), one) for one in words)


def check_writers(steps: Sequence[Step], placed: Collection[tuple[str, Service]], look: Gathering) -> None:
    """Refuse a mounted path that lies in a folder which a container of the experiment writes to, by another name.

    Args:
        steps: What is going to be done.
        placed: Robot and service, of all that run on robots of the plan.
        look: Asks robots.

    Raises:
        UsageError: Names each, and what to write instead.
    """
    busy = {step.host for step in steps if step.module in RUNNING and step.want and step.commands}
    mounts: dict[str, list[tuple[str, Mount]]] = {}
    for robot, service in placed:
        if robot in busy:
            binds = [one for one in service.runtime.mounts if one.kind == "bind"]
            mounts.setdefault(robot, []).extend((service.name, one) for one in binds)
    sources = {robot: sorted({one.source for _, one in some}) for robot, some in mounts.items() if _matters(some)}
    replies = look.ask_each({robot: (_question(some), _MOUNTS) for robot, some in sources.items()})
    # thousands of paths may take a robot longer than it has
    wrong = [f"{robot}: it does not say what its paths are" for robot in sorted(sources.keys() - replies.keys())]
    wrong += [
        f"{robot}: {line}"
        for robot, (reply, mounted) in replies.items()
        for line in _below(mounts[robot], _places(sources[robot], reply.out), _Mounts(mounted.out))
    ]
    if wrong:
        hint = f"mount it by the name of that folder, which asks for {GRAVE}; or let it be mounted read-only"
        raise UsageError("containers would mount what others make:\n" + "\n".join(wrong), hint=hint, code=Code.NO_ROOM)


def _matters(some: Collection[tuple[str, Mount]]) -> bool:
    return any(not one.read_only for _, one in some) and len({one.source for _, one in some}) > 1


def _question(sources: Iterable[str]) -> Query:
    looks = (_LOOK.replace("NUMBER", str(at)).replace("PATH", quote(one)) for at, one in enumerate(sources))
    return Query(command="\n".join([_NEWLINE, *looks, ":"]))


def _places(sources: Sequence[str], said: str) -> dict[str, _Place]:
    """Read what a robot says, which is its own word for its own paths."""
    found: dict[str, tuple[str, list[str]]] = {}
    ids: list[str] = []
    for line in lines_of(said, _MOST_LINES):
        number, blank, real = line.partition(" ")
        if blank and number.isdecimal() and int(number[:9]) < len(sources):
            ids = []
            found[sources[int(number[:9])]] = text(real, length=4096), ids
        elif line:
            ids.append(line[:60])
    places = {}
    for source, (real, some) in found.items():
        depth = len([part for part in real.split("/") if part])
        places[source] = _Place(real=real, folders=frozenset(some), own=some[0] if len(some) == depth > 0 else "")
    return places


def _below(
    mounts: Iterable[tuple[str, Mount]], places: dict[str, _Place], mounted: _Mounts
) -> Iterator[str]:  # fmt: skip
    some = [(name, one) for name, one in mounts if one.source in places]
    written = {one.source for _, one in some if not one.read_only}
    is_below = below(places[source].real for source in written)
    made = {places[source].own for source in written} - {""}
    named = below(written)
    shown = below(f"/{one}" for source in written for one in mounted.shown(places[source].real))
    for name, one in sorted({(name, one.source): (name, one) for name, one in some}.values(), key=lambda it: it[0]):
        place = places[one.source]
        if named(one.source) or mount_kind(one.source)[0] == GRAVE:
            continue  # asked for as that
        is_shown = shown(f"/{mounted.place(place.real)}")
        if not place.real.startswith("/") or is_below(place.real) or made & (place.folders - {place.own}) or is_shown:
            yield f"{one.source}, which '{name}' mounts, lies in a folder that a container of the experiment writes to"
