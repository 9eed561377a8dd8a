"""Checks of what was measured: metrics are taken again from the files, and verdicts and images compared."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.evidence.files import Files, NotThere, Undecided, content, json_of
from srprov.evidence.session import Session
from srprov.evidence.story import Story, attempt_folder, attempt_of
from srprov.record.results import timed_lines
from srprov.trials.judge import COUNTED, Match, verdict
from srprov.trials.marks import Row
from srprov.trials.metrics import MOST_BYTES, from_json, scan
from srprov.trials.reading import read
from srprov.untrusted import mapping, mappings, string, string_map

_SEARCH_S, _PACE = 10.0, 1 << 20
"""For the logs of all attempts together, and the bytes of them that give a second back."""


class Patience:
    """How long logs are looked through for patterns of a stranger's: a short one may take seconds for a long line."""

    def __init__(self) -> None:
        """Begin to wait."""
        self._end = time.monotonic() + _SEARCH_S

    def tick(self, size: int) -> None:
        """Take so many bytes that are looked through from now on, which give time back.

        Raises:
            Undecided: It takes too long.
        """
        self._end += size / _PACE
        if time.monotonic() > self._end:
            raise Undecided(f"its patterns take longer than {_SEARCH_S:.0f} s, and a second for each MiB of a log")


def measured(story: Story, files: Files) -> Iterator[str]:
    """Take each metric again from logs and results, and judge each attempt again.

    Raises:
        Undecided: The experiment's patterns take too long.
    """
    patience = Patience()
    for session, row in _whole(story):
        folder = attempt_folder(row)
        metrics, matched = again(session, folder, files, patience)
        for one in session.given.metrics:
            now, then = metrics.get(one.name), row.get(f"m_{one.name}")
            if now != then:
                yield f"{folder}: {one.name} is {_short(then)}, and the files give {_short(now)}"
        containers = json_of(files, f"{folder}/containers.json")
        readings = {name: read(one) for name, one in containers.items()}
        follows = verdict(session.given.settings.success, readings, matched, metrics)
        if follows != row.get("verdict"):
            yield f"{folder}: the verdict is {_short(row.get('verdict'))}, and follows as {follows}"


def _whole(story: Story) -> Iterator[tuple[Session, Row]]:
    for row in story.ended:
        session = story.of.get(attempt_of(row))
        if row.get("status") in COUNTED and session is not None:
            yield session, row


def again(
    session: Session, folder: str, files: Files, patience: Patience
) -> tuple[dict[str, float], set[Match]]:  # fmt: skip
    """Return an attempt's metrics, and what of `success` its logs match, from its files alone."""
    given = session.given
    found: dict[str, float] = {}
    for one in given.metrics:
        if (
            one.file
            and (value := _from_file(files, f"{folder}/results/{one.service}{one.file}", one.pointer)) is not None
        ):
            found[one.name] = value
    items = given.settings.success.items if given.settings.success else ()
    matched: set[Match] = set()
    for service, robot in session.services.items():
        metrics = [one for one in given.metrics if one.pattern and one.service == service]
        patterns = [one.pattern for one in items if one.pattern and service in one.services]
        if metrics or patterns:
            lines = _lines(files, f"{folder}/logs/{robot}.{service}.log")
            scanned = scan(lines, metrics, patterns, patience.tick)
            found |= scanned.values
            matched |= {(service, pattern) for pattern in scanned.first}
    return found, matched


def _from_file(files: Files, name: str, pointer: str) -> float | None:
    try:
        return from_json(content(files, name, MOST_BYTES).decode("utf-8", "replace"), pointer)
    except NotThere:
        return None


def _lines(files: Files, name: str) -> Iterator[tuple[str, str]]:
    """Return the time and the text of each line of a log, as they were read when the attempt ended."""
    if name not in files.sizes:
        return
    with io.TextIOWrapper(io.BufferedReader(_Raw(files.pieces(name))), "utf-8", "replace", "\n") as stream:
        yield from timed_lines(stream)


class _Raw(io.RawIOBase):
    """Pieces as a stream."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces, self._left = pieces, b""

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, buffer: Any) -> int:  # noqa: ANN401 - a writable buffer, which has no name in Python 3.10
        """Fill a buffer as far as the present piece goes."""
        self._left = self._left or next(self._pieces, b"")
        some = self._left[: len(buffer)]
        buffer[: len(some)] = some
        self._left = self._left[len(some) :]
        return len(some)


def images(story: Story, files: Files) -> Iterator[str]:
    """Compare the image of each container with what the journal states for its segment."""
    known: dict[tuple[int, str], str] = {}
    stated = _stated(story)
    for session, row in _whole(story):
        folder, segment = attempt_folder(row), row.get("segment")
        same = stated[segment - 1] if isinstance(segment, int) and 0 < segment <= len(stated) else {}
        for service, one in json_of(files, f"{folder}/containers.json").items():
            image = string(mapping(one).get("Image"))
            wanted = same.get(f"{service}: image id") or known.setdefault((segment or 0, service), image)
            if service in session.services and image != wanted:
                yield f"{folder}: the image of {service} is {image[:80]}, and was {wanted[:80]}"


def _stated(story: Story) -> Sequence[Mapping[str, str]]:
    """Return what the journal states must be the same, for each segment."""
    found: list[Mapping[str, str]] = [
        string_map(one.get("same")) for one in story.events if one["event"] in ("run", "accept")
    ]
    return found or [{}]


def robots(story: Story, files: Files) -> Iterator[str]:
    """Look whether all that was measured is of robots that the placement names."""
    for row in story.ended:
        session = story.of.get(attempt_of(row))
        if session is None:
            continue
        there = set(session.assignment.values())
        for key in ("clocks", "hosts", "containers"):
            said = {string(one.get("robot")) for one in mappings(row.get(key))}
            if strange := sorted(said - there):
                yield f"{attempt_folder(row)}: {key} is of {', '.join(strange)[:80]}, where nothing was placed"
    for session in story.sessions:
        facts = mapping(json_of(files, f"{session.home}/facts.json").get("robots"))
        for service, robot in session.assignment.items():
            if robot not in facts:
                yield f"{session.home}: nothing is known of {robot[:80]}, where {service[:80]} ran"


def _short(value: object) -> str:
    return "nothing" if value is None else str(value)[:80]
