"""Results and logs of one container, brought home: for a trial and for an applied experiment alike."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from srprov.controller.bringing import Bringing, Home
from srprov.definitions.trialsmodel import Result
from srprov.execution.collect import CollectFailed, Robot, listings, place_of
from srprov.record.recordings import checked
from srprov.record.results import Kept, LogTooLong, write_log
from srprov.session import Session


@dataclass(frozen=True, slots=True)
class Brought:
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
    there = dict(zip(places, listings(robot, list(places.values())), strict=True))
    found: dict[Result, list[Kept]] = {}
    brought = Brought()
    for result, entries in sorted(there.items(), key=lambda one: len(one[0].path)):
        if entries is None:
            continue
        size = sum(one.size for one in entries if one.is_file)
        if any(result.path.startswith(f"{one.path.rstrip('/')}/") for one, some in found.items() if _has_some(some)):
            found[result] = []  # it came with the folder that it is in
        elif result.most_bytes and size > result.most_bytes:
            note = f"left on {robot.host}: it has {size} bytes, more than its `max`"
            found[result] = [Kept(path=result.path, size=size, note=note)]
        else:
            # listed paths begin with the result's own name; of a mount's root with what is in it
            whole = places[result].path == "."
            below = folder / (result.path if whole else posixpath.dirname(result.path)).strip("/")
            bringing = Bringing(robot, places[result], below, home)
            if (kept := bringing.all(entries)) is not None:
                found[result] = checked(below, kept, home.parts)
            brought = Brought(brought.files + bringing.fetched_files, brought.bytes + bringing.fetched_bytes)
    return found, brought


def listed(one: Kept) -> dict[str, object]:
    """Return what `collected.json` says of an entry."""
    about = {"path": one.path, "name": one.name, "size": one.size, "sha256": one.sha256, "note": one.note}
    about |= {"unclosed": one.unclosed, "recovered": one.recovered}
    return {key: value for key, value in about.items() if value not in ("", 0) or key == "path"}


def _has_some(kept: list[Kept]) -> bool:
    return any(one.name for one in kept)
