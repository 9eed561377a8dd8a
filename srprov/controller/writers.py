"""Paths of a robot that a container of an experiment may write to, by whatever names they are mounted.

What lies below such a folder is whatever that container wants: a link to the engine, too. Policies compare paths as
they are written, and a robot has further names for them: `/var/lock` is a link to `/run/lock`, a folder may be mounted
twice, or a part of it. What is mounted below a path is writable also where that is mounted read-only. So the robots of
new containers are asked, where there are two paths.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Iterator, Sequence

import msgspec

from srprov.codes import Code
from srprov.controller.robot_mounts import MOUNTS, Mounts
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Service
from srprov.errors import UsageError
from srprov.facts.gather import Gathering
from srprov.modules import RUNNING
from srprov.modules.mount_kind import GRAVE, SHARED_MEMORY, below, mount_kind
from srprov.planning.plan import Step
from srprov.robot_answers import TooManyError
from srprov.untrusted import lines_of, text
from srprov.wire import Query, quote

_MOST_LINES = 100_000
_SHARED = Mount(kind="bind", source=SHARED_MEMORY, target="")
"""Of a container in the robot's IPC namespace."""
_NEWLINE = "newline='\n'"
_LOOK = r"""number=-1
for s in PATHS; do
number=$((number + 1)) left=$s at= links=0 odd=
set --
while [ -n "$left" ]; do
  part=${left%%/*}
  case $left in
  */*) left=${left#*/} ;;
  *) left= ;;
  esac
  case $part in
  '') ;;
  .) ;;
  ..) at=${at%/*} ;;
  *)
    set -- "$@" "${at:-/}"
    to=
    [ ! -L "$at/$part" ] || to=$(readlink "$at/$part" && printf x)
    to=${to%"$newline"x}
    case $at$part$to in
    *"$newline"*) odd=? ;;
    esac
    if [ -z "$to" ]; then at=$at/$part
    else
      links=$((links + 1)) left=$to/$left
      case $to in
      /*) at= ;;
      esac
    fi ;;
  esac
  [ $links -lt 40 ] && [ $# -lt 200 ] && [ ${#at} -lt 1000 ] || odd=? left=
done
printf '%s %s\n' $number "${odd:-${at:-/}}"
[ -n "$odd" ] || stat -c '%d:%i %n' "$@" "${at:-/}" 2>/dev/null
done"""
"""Go through each path as the kernel does. Print its number and where it leads; then device and inode of each folder in
which a part of it was looked for, also by way of links, and in the end its own, of what is there. What has a name of
several lines, is longer than people write, or goes through hundreds of folders leads nowhere that could be told: a
command takes only so many words, and the kernel no such name at once."""


class _Place(msgspec.Struct, frozen=True):
    """What a robot says of a path."""

    real: str
    through: tuple[tuple[str, str], ...]
    """Device and inode and name of each folder in which a part of it was looked for: who writes there turns it."""
    own: str
    """Device and inode of it; empty: it is not there."""


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
            shared = [_SHARED] if service.runtime.ipc == "host" else []
            mounts.setdefault(robot, []).extend((service.name, one) for one in (*shared, *binds))
    sources = {robot: sorted({one.source for _, one in some}) for robot, some in mounts.items() if _matters(some)}
    replies = look.ask_each({robot: (_question(some), MOUNTS) for robot, some in sources.items()})
    # thousands of paths may take a robot longer than it has
    wrong = [f"{robot}: it does not say what its paths are" for robot in sorted(sources.keys() - replies.keys())]
    for robot, (reply, mounted) in replies.items():
        if not (reply.ok and mounted.ok):
            wrong.append(f"{robot}: it does not say what its paths are: {text((reply.err or mounted.err).strip())}")
            continue
        try:
            some = list(_below(mounts[robot], _places(sources[robot], reply.out), Mounts(mounted.out)))
        except TooManyError as error:
            some = [str(error)]
        wrong += [f"{robot}: {line}" for line in some]
    if wrong:
        hint = f"mount it by the name of that folder, which asks for {GRAVE}; or let it be mounted read-only"
        raise UsageError("containers would mount what others make:\n" + "\n".join(wrong), hint=hint, code=Code.NO_ROOM)


def _matters(some: Collection[tuple[str, Mount]]) -> bool:
    return len({one.source for _, one in some}) > 1


def _question(sources: Iterable[str]) -> Query:
    return Query(command="\n".join([_NEWLINE, _LOOK.replace("PATHS", " ".join(map(quote, sources))), ":"]))


def _places(sources: Sequence[str], said: str) -> dict[str, _Place]:
    """Read what a robot says, which is its own word for its own paths.

    Raises:
        TooManyError: It says more than is read, or leaves one out: of that nothing is known.
    """
    lines = lines_of(said, _MOST_LINES + 1)
    if len(lines) > _MOST_LINES:
        raise TooManyError(f"its paths lead through more than {_MOST_LINES} folders")
    found: dict[str, tuple[str, list[tuple[str, str]]]] = {}
    folders: list[tuple[str, str]] = []
    for line in lines:
        word, _, name = line.partition(" ")
        if word.isdecimal() and int(word[:9]) < len(sources):
            folders = []
            found[sources[int(word[:9])]] = text(name, length=4096), folders
        elif name:
            folders.append((word[:60], text(name, length=4096)))
    if unknown := sorted({*sources} - found.keys()):
        raise TooManyError(f"it does not say what its path {unknown[0]} is")
    places = {}
    for source, (real, some) in found.items():
        there = bool(some) and some[-1][1] == real
        *through, (own, _) = some if there else [*some, ("", "")]
        places[source] = _Place(real=real, through=tuple(through), own=own)
    return places


def _below(
    mounts: Iterable[tuple[str, Mount]], places: dict[str, _Place], mounted: Mounts
) -> Iterator[str]:  # fmt: skip
    some = list(mounts)
    written = {one.source for _, one in some if not one.read_only}
    made = {places[source].own for source in written} - {""}
    named, is_below = below(written), below(places[source].real for source in written)
    inner = {point for _, one in some if one.read_only for point in mounted.writable_below(places[one.source].real)}
    shown = below(f"/{one}" for one in mounted.shown([*(places[one].real for one in written), *inner]))

    @functools.cache  # thousands of paths have the folders above them in common
    def is_written(path: str) -> bool:
        return is_below(path) or any(shown(f"/{one}") for one in mounted.places(path))

    for name, one in sorted({(name, one.source): (name, one) for name, one in some}.values(), key=lambda it: it[0]):
        place = places[one.source]
        if one is _SHARED or named(one.source) or mount_kind(one.source)[0] == GRAVE:
            continue  # mounted by nobody, or asked for as that
        turned = any(own in made or is_written(f"{path.rstrip('/')}/x") for own, path in place.through)
        if turned or not place.real.startswith("/") or is_written(place.real):
            yield f"{one.source}, which '{name}' mounts, lies in a folder that a container of the experiment writes to"
