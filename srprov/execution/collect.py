"""What a container left in a folder or file, as a tar with its hash, in pieces over the robot's connection.

GNU tar writes the same tar each time as long as nothing changes, so the robot can say its sha256 first, a transfer that
was cut goes on where it ended, and who has the whole tar compares.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from srprov.errors import TransportError
from srprov.pace import TOO_LITTLE, Pace
from srprov.session import Session, Streams
from srprov.untrusted import mapping, mappings, string
from srprov.wire import Query, quote

_HASH_S = 3600.0
_SAID = re.compile("(?P<size>[0-9]{1,15}) (?P<entries>[0-9]{1,9}) (?P<hash>[0-9a-f]{64})\\s*")
_END = b"srprov-end"
_ENTRY = 16 << 10
"""Bytes that a tar may hold for an entry beside its content: headers, and extended ones with its names."""
_LONGEST_COMPLAINT = 16_384
_TAR = (
    "tar --create --format=posix --sort=name --numeric-owner --hard-dereference"
    " '--pax-option=exthdr.name=%d/PaxHeaders/%f,delete=atime,delete=ctime'"
)
_MISSING = 44


class CollectFailed(Exception):
    """A result could not be read on its robot; the text says why."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Place:
    """Where on its robot a result of a container lies."""

    root: str
    """Folder of the robot that the container saw; what lies outside of it is not read."""
    path: str
    """Relative to that; `.` for all of it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Offer:
    """What there is to fetch."""

    size: int
    """Bytes of files."""
    most: int
    """Bytes that the tar has at most."""
    sha256: str
    """Of the tar."""


def place_of(inspected: object, path: str) -> Place | None:
    """Return where a container's path lies on its robot, by what the engine says of its mounts; None: in no mount."""
    best: tuple[int, Mapping[str, Any], str] | None = None
    for mount in mappings(mapping(inspected).get("Mounts")):
        target = string(mount.get("Destination")).rstrip("/")
        inside = path == target or path.startswith(f"{target}/")
        if (
            target
            and inside
            and string(mount.get("Source")).startswith("/")
            and (best is None or best[0] < len(target))
        ):
            best = (len(target), mount, path[len(target) :].strip("/") or ".")
    return Place(root=string(best[1].get("Source")), path=best[2]) if best else None


def offers(session: Session, places: Sequence[Place]) -> list[Offer | None]:
    """Return what there is at each place, in one round trip; None for nothing.

    Raises:
        CollectFailed: Something cannot be read.
        TransportError: The robot cannot be talked to any more.
    """
    replies = session.ask([Query(command=_hash_script(one), timeout_s=_HASH_S) for one in places])
    found: list[Offer | None] = []
    for place, reply in zip(places, replies, strict=True):
        match = _SAID.fullmatch(reply.out)
        if reply.status == _MISSING:
            found.append(None)
        elif reply.ok and match:
            size, entries = int(match["size"]), int(match["entries"])
            found.append(Offer(size=size, most=size + (entries + 2) * _ENTRY, sha256=match["hash"]))
        else:
            why = " ".join((reply.err or reply.out).split())[-300:]
            raise CollectFailed(f"{session.host}: {place.path} cannot be read: {why or f'status {reply.status}'}")
    return found


def fetch(session: Session, place: Place, sink: Callable[[bytes], object], skip: int = 0) -> None:
    """Give the tar of a place to `sink`, in pieces, from byte `skip` on.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    script = f'{_inside(place)}; {_TAR} -- "$what" | tail -c +{skip + 1} && echo {_END.decode()} >&2'
    streams = session.open_shell(script)
    try:
        _pump(session.host, streams, sink)
    finally:
        streams.close()


def _hash_script(place: Place) -> str:
    sizes = "find \"$what\" -type f -printf '%s\\n' -o -printf '0\\n'"
    size = f"{sizes} | awk '{{n += $1}} END {{printf \"%.0f %d \", n, NR}}'"
    return f'{_inside(place)}; {size}; {{ {_TAR} -- "$what" || head -c 32 /dev/urandom; }} | sha256sum | cut -c 1-64'


def _inside(place: Place) -> str:
    """Return a script that goes to the folder of a place and sets `what`, its name there.

    The kernel says where the working folder is: whatever runs there may put links in the way meanwhile, and neither tar
    nor find follow one that they are named.
    """
    folder, name = posixpath.split(posixpath.normpath(place.path))
    return (
        f'here=$(realpath -e -- {quote(place.root)} 2>/dev/null) && cd -- "$here" || exit {_MISSING}; '
        f"folder={quote(folder)}; what={quote('./' + (name if name != '.' else ''))}; "
        f'if [ "$folder" ]; then cd -- "./$folder" 2>/dev/null || exit {_MISSING}; fi; '
        '[ "$(pwd -P)" = "$here${folder:+/$folder}" ] || { echo "a link leads out of its folder" >&2; exit 1; }; '
        f'[ -e "$what" ] || [ -L "$what" ] || exit {_MISSING}'
    )


def _pump(host: str, streams: Streams, sink: Callable[[bytes], object]) -> None:
    """Pass on what comes, to its end."""
    complaint, pace = bytearray(), Pace()
    while True:
        piece, error = streams.read()
        complaint += error[: _LONGEST_COMPLAINT - len(complaint)]
        if not pace.goes_on(len(piece)):
            said = " ".join(complaint.decode("utf-8", "replace").split())[-200:]
            raise TransportError(host, f"of a result came {TOO_LITTLE} {said}".strip())
        if piece:
            sink(piece)
            pace.resume()
        elif error:
            continue
        elif streams.ended:
            if _END not in complaint:
                raise TransportError(host, f"a result ended too early: {streams.reason()}")
            return
        else:
            streams.wait(0.2, writing=False)
