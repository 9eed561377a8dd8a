"""What a container left in a folder or file: listed with hashes by its robot, and fetched over its connection.

Large files come one by one, the others in one tar. GNU tools read both in the folder that the container saw, follow no
links, and go on where a transfer was cut. Whoever fetches compares each file with the listing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import msgspec

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution.listing import Entry, Listing, ListingError
from srprov.execution.result_scripts import TAR, UNNAMEABLE, WHY, lists
from srprov.led import led_of, mounted_at
from srprov.pace import TOO_LITTLE, Pace
from srprov.sandbox import ENDED, MISSING, ended_with_channel, ending, inside
from srprov.session import Session, Streams
from srprov.untrusted import absolute, mapping, mappings

_T = TypeVar("_T")
_HASHED_PER_S = 2 << 20
"""Bytes that the slowest robot hashes, from the slowest memory card."""
_HASHING_S = 3600.0
_PAUSE_S = 0.2
_READY = b"srprov-ready\n"
_LONGEST_COMPLAINT = 16_384
_MOST_MOUNTS = 1000  # of a container: an EDF names no more, but images may


class CollectFailed(Exception):
    """A result could not be read on its robot; the text says why."""


class TransferCut(CollectFailed):
    """The link carried next to nothing, or each connection ended at once; nothing is known to be wrong on the robot."""


class Robot(Protocol):
    """A robot whose connection may be lost, and is then made anew."""

    @property
    def host(self) -> str:
        """Its name."""

    def do(self, work: Callable[[Session], _T]) -> _T:
        """Do something with its session, again if the connection is lost meanwhile."""


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """Where on its robot a result of a container lies."""

    root: str
    """Folder of the robot that the container saw; what lies outside of it is not read."""
    path: str
    """Relative to that; `.` for all of it."""
    real: str = ""
    """Where the root led when the container was made: who may write above it can have put a link there since."""


def place_of(inspected: object, path: str) -> Place | None:
    """Return where a container's path lies on its robot, by its engine's word; None: in no mount; or CollectFailed."""
    best: tuple[int, Mapping[str, Any], str] | None = None
    for mount in _mounts(inspected):
        target = mounted_at(mount).rstrip("/")
        inside = target and (path == target or path.startswith(f"{target}/"))
        if inside and absolute(mount.get("Source")) and (best is None or best[0] < len(target)):
            best = (len(target), mount, path[len(target) :].strip("/") or ".")
    return _placed(best[1], best[2], led_of(inspected)) if best else None


def places_below(inspected: object, path: str) -> list[tuple[str, Place]]:
    """Return the mounts that lie in a container's folder, and may have been written to: where, relative to it.

    What the folder itself lies in shows an empty folder at their places. Raises CollectFailed.
    """
    found: dict[str, Place] = {}
    led = led_of(inspected)
    for mount in _mounts(inspected):
        target, source = mounted_at(mount), absolute(mount.get("Source"))
        if target.startswith(f"{path.rstrip('/')}/") and source and mount.get("RW") is not False:
            found[target[len(path.rstrip("/")) :].strip("/")] = _placed(mount, ".", led)
    return sorted(found.items())


def _placed(mount: Mapping[str, Any], path: str, led: Mapping[str, str]) -> Place:
    """Return a path below a mount; of a path of the robot's the container's label says where it led."""
    root = absolute(mount.get("Source"))
    return Place(root=root, path=path, real=led.get(root, ""))


def _mounts(inspected: object) -> list[Mapping[str, Any]]:
    every = mappings(mapping(inspected).get("Mounts"), most=_MOST_MOUNTS + 1)
    if len(every) > _MOST_MOUNTS:  # in any order: of no path would be known that it lies in none
        raise CollectFailed(f"it has more than {_MOST_MOUNTS} mounts: where its results lie cannot be told")
    return every


def listings(robot: Robot, places: Sequence[Place]) -> list[list[Entry] | None]:
    """Return what there is at each place, by path, all in one round trip; None for nothing.

    Raises:
        CollectFailed: Something cannot be read.
        EquipmentFailed: The robot stays away.
    """
    if not places:
        return []
    script = "; ".join(f"( {lists(one.root, one.path, one.real)} ); printf '=%d\\0' $?" for one in places)

    def work(session: Session) -> list[tuple[int, list[Entry]]]:
        found, pace, allowed = Listing(len(places)), Pace(), 0.0
        streams = session.open_shell(ending(ended_with_channel(script, _HASHING_S + 60)))
        try:
            for piece in _pieces(robot.host, streams, pace):
                found.feed(piece)
                longer = min(_HASHING_S, found.bytes / _HASHED_PER_S)
                pace.extend(longer - allowed)
                allowed = longer
            return found.all()
        except ListingError as error:
            raise CollectFailed(f"{robot.host}: {error}") from error
        finally:
            streams.close()

    return [_readable(robot.host, place, *one) for place, one in zip(places, robot.do(work), strict=True)]


def _readable(host: str, place: Place, status: int, entries: list[Entry]) -> list[Entry] | None:
    """Return a place's entries, or None for nothing there."""
    if status in WHY and status != MISSING:
        raise CollectFailed(f"{host}: {place.path} cannot be read: {WHY[status]}")
    return None if status == MISSING else entries


def fetch_file(robot: Robot, place: Place, size: int, at: int) -> Iterator[bytes]:
    """Yield the file at a place from byte `at` on, on new connections when some are lost.

    Raises:
        TransferCut, CollectFailed: Nothing of it comes any more; it cannot be read.
        EquipmentFailed: The robot stays away.
    """

    def opened(session: Session, at: int) -> Streams:
        window = f"iflag=nofollow,nonblock,skip_bytes,count_bytes,fullblock skip={at} count={size - at}"
        dd = f'dd if="$what" {window} bs=1M status=none'
        return session.open_shell(ending(inside(place.root, place.path, dd, place.real)))

    return _resumed(robot, place, opened, at, size)


def fetch_tar(robot: Robot, place: Place, without: Collection[str], most: int) -> Iterator[bytes]:
    """Yield a place as a tar without some of its files, on new connections when some are lost.

    Raises:
        TransferCut, CollectFailed: Nothing of it comes any more; it has more than `most` bytes, or cannot be read.
        EquipmentFailed: The robot stays away.
    """
    names = "".join(f"./{one}\n" for one in sorted(without) if not UNNAMEABLE.search(one))
    listed = names.encode("utf-8", "surrogateescape")
    words = "--anchored --no-wildcards --exclude-from=-" if listed else ""
    given = f"printf '{_READY.decode().strip()}\\n'; head -c {len(listed)} | " if listed else ""

    def opened(session: Session, at: int) -> Streams:
        # whether a file changed under tar, or went, its hash says: tar's own status is not needed
        tar = f'{given}{TAR} {words} -- "$what" | tail -c +{at + 1}'
        streams = session.open_shell(ending(inside(place.root, place.path, tar, place.real)))
        if listed:
            _give(robot.host, streams, memoryview(listed))
        return streams

    return _resumed(robot, place, opened, 0, most)


def _resumed(
    robot: Robot, place: Place, opened: Callable[[Session, int], Streams], at: int, end: int
) -> Iterator[bytes]:
    """Yield what comes, and when it is cut go on where it ended; `end` is the most that there may be."""
    pace = Pace()
    while True:
        here = at
        streams = robot.do(lambda session: opened(session, here))  # noqa: B023 - it is done at once
        pace.resume()
        try:
            for piece in _pieces(robot.host, streams, pace):
                at += len(piece)
                if at > end:
                    raise CollectFailed(f"{robot.host}: {place.path} has more than it said")
                yield piece
                pace.resume()
            return
        except TransportError as error:
            if not pace.goes_on(0):
                raise TransferCut(error.message) from error
            time.sleep(_PAUSE_S)  # counted: who lets each connection end at once has so many of them
            pace.goes_on(0)
        finally:
            streams.close()


def _give(host: str, streams: Streams, data: memoryview) -> None:
    """Send a shell what it reads, once it says that it is ready."""
    pace, said = Pace(), b""
    while not said.endswith(_READY) or data:
        said = (said + streams.read()[0])[-len(_READY) :]
        sent = streams.write(data) if said.endswith(_READY) else 0
        data = data[sent:]
        if streams.ended or not pace.goes_on(sent):
            streams.close()
            raise TransportError(host, f"it does not take the list of what is here: {streams.reason()}", code=Code.LOST)
        if not sent:
            streams.wait(0.2, writing=said.endswith(_READY))


def _pieces(host: str, streams: Streams, pace: Pace) -> Iterator[bytes]:
    """Yield what comes, to its end.

    Raises:
        CollectFailed: The script failed.
        TransportError: It ends too early, or next to nothing comes.
    """
    complaint = b""
    while True:
        piece, error = streams.read()
        complaint = (complaint + error)[-_LONGEST_COMPLAINT:]
        if not pace.goes_on(len(piece)):
            raise TransportError(host, f"of a result came {TOO_LITTLE} {_said(complaint)}".strip(), code=Code.RESULTS)
        if piece:
            yield piece
        elif error:
            continue
        elif streams.ended:
            ended = ENDED.search(complaint)
            if ended is None:
                raise TransportError(host, f"a result ended too early: {streams.reason()}", code=Code.RESULTS)
            if int(ended[1]):
                why = _said(complaint[: ended.start()]) or WHY.get(int(ended[1]), f"status {int(ended[1])}")
                raise CollectFailed(f"{host}: a result cannot be read: {why}")
            return
        else:
            streams.wait(0.2, writing=False)


def _said(complaint: bytes) -> str:
    return " ".join(complaint.decode("utf-8", "replace").split())[-300:]
