"""Results and logs of one container, brought home: for a trial and for an applied experiment alike."""

from __future__ import annotations

import bisect
import posixpath
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from srprov.controller.bringing import Bringing, Home
from srprov.definitions.trialsmodel import Result
from srprov.execution.collect import CollectFailed, Place, Robot, listings, place_of, places_below
from srprov.execution.listing import MOUNT, Entry
from srprov.record.recordings import checked
from srprov.record.results import Kept, LogTooLong, is_safe_name, write_log
from srprov.session import Session


class Brought(msgspec.Struct, frozen=True):
    """What came; all else was here."""

    files: int = 0
    bytes: int = 0


def bring_log(robot: Robot, container: str, path: Path) -> None:
    """Write a container's log, with the engine's times.

    Raises:
        CollectFailed: It is too long.
        EquipmentFailed: The robot does not give it.
        OSError: It cannot be written here.
    """

    def work(session: Session) -> None:
        try:
            write_log(session.container_log(container, tail=-1, follow=False, times=True), path)
        except LogTooLong as error:
            raise CollectFailed(f"{session.host}: {container}: {error}; print less") from error

    robot.do(work)


def bring_results(
    robot: Robot, inspected: object, wanted: Sequence[Result], folder: Path, home: Home
) -> tuple[dict[Result, list[Kept]], Brought]:
    """Bring a container's results into the folder of its service; one that is nowhere is left out.

    Args:
        robot: Where the container is.
        inspected: What the engine says of it.
        wanted: Its results.
        folder: Of the service.
        home: Where parts come, and whom to tell.

    Raises:
        CollectFailed, EquipmentFailed: The robot does not give it.
        OSError: Something cannot be written here.
    """
    places = {result: place for result in wanted if (place := place_of(inspected, result.path))}
    inner = {result: places_below(inspected, result.path) for result in places}
    every = list(dict.fromkeys((*places.values(), *(place for some in inner.values() for _, place in some))))
    there = dict(zip(every, listings(robot, every), strict=True))
    found: dict[Result, list[Kept]] = {}
    brought = Brought()
    for result, place in sorted(places.items(), key=lambda one: len(one[0].path)):
        if there[place] is None:
            continue
        parts = list(_parts(result, place, inner[result], there))
        size = sum(entry.size for one in parts for entry in one.entries if entry.is_file)
        if any(result.path.startswith(f"{one.path.rstrip('/')}/") for one, some in found.items() if _has_some(some)):
            found[result] = []  # it came with the folder that it is in
        elif result.most_bytes and size > result.most_bytes:
            note = f"left on {robot.host}: it has {size} bytes, more than its `max`"
            found[result] = [Kept(path=result.path, size=size, note=note)]
        else:
            # listed paths begin with the result's own name; of a mount's root with what is in it
            whole = place.path == "."
            below = folder / (result.path if whole else posixpath.dirname(result.path)).strip("/")
            came: list[list[Kept] | None] = []
            for one in parts:
                bringing = Bringing(robot, one.place, below / one.at, home, one.apart)
                came.append(bringing.all(one.entries))
                brought = Brought(brought.files + bringing.fetched_files, brought.bytes + bringing.fetched_bytes)
            if any(some is not None for some in came):
                kept = [_moved(one, part.at) for part, some in zip(parts, came, strict=True) for one in some or ()]
                found[result] = checked(below, kept, home.parts)
    return found, brought


class _Part(msgspec.Struct, frozen=True):
    """What one mount has of a result."""

    at: str
    """Where it lies below the result's folder here; empty: it is all of that."""
    place: Place
    entries: list[Entry]
    apart: tuple[str, ...]
    """What lies in it, and is another part's."""


def _parts(
    result: Result, place: Place, inner: Sequence[tuple[str, Place]], there: Mapping[Place, list[Entry] | None]
) -> Iterator[_Part]:
    """Return what a result consists of: its folder as the container saw it, with the mounts in it.

    Raises:
        CollectFailed: The robot names a mount as nothing here can be called.
    """
    name = "" if place.path == "." else posixpath.basename(result.path.rstrip("/"))
    places = [("", place), *((posixpath.join(name, at), one) for at, one in inner)]
    for at, one in places:
        if at and not is_safe_name(at):
            raise CollectFailed(f"{result.path}: no folder here can have the name of its mount {at[:200]!r}")
        below = [other for other, _ in places if other.startswith(f"{at}/" if at else "") and other != at]
        apart = tuple(posixpath.relpath(other, at or ".") for other in below)
        yield _Part(at, one, _seen(at, there[one] or [], below), apart)


def _seen(at: str, entries: list[Entry], mounts: Sequence[str]) -> list[Entry]:
    """Return entries, which are in the order of their paths, without what lies under the place of another mount.

    The container did not see that.
    """
    places = frozenset(mounts)
    entries = [one for one in entries if one.kind != MOUNT or posixpath.join(at, one.path) not in places]
    paths = [posixpath.join(at, one.path) for one in entries] if mounts else []
    hidden = bytearray(len(entries))
    for mount in mounts:
        first, last = (bisect.bisect_left(paths, f"{mount}{end}") for end in "/0")  # 0 comes right after /
        hidden[first:last] = b"\1" * (last - first)
    return [one for one, is_hidden in zip(entries, hidden, strict=True) if not is_hidden]


def _moved(one: Kept, at: str) -> Kept:
    return replace(one, path=posixpath.join(at, one.path), name=posixpath.join(at, one.name) if one.name else "")


def listed(one: Kept) -> dict[str, object]:
    """Return what `collected.json` says of an entry."""
    about = {"path": one.path, "name": one.name, "size": one.size, "sha256": one.sha256, "note": one.note}
    about |= {"unclosed": one.unclosed, "recovered": one.recovered}
    return {key: value for key, value in about.items() if value not in ("", 0) or key == "path"}


def _has_some(kept: list[Kept]) -> bool:
    return any(one.name for one in kept)
