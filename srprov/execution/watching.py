"""Containers of several robots, looked at again and again, with their logs where somebody looks for a line.

Only reads. A connection that is lost is made anew, and an engine that is away is waited for, for as long as trials do.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from urllib.parse import quote as url_quote

import msgspec

from srprov.errors import TransportError
from srprov.execution.trial_patience import EngineAway, EquipmentFailed, Patience, Say
from srprov.failure import why
from srprov.linear_regex import compiled
from srprov.robot_answers import answers_of
from srprov.session import Session
from srprov.trials.metrics import LONGEST_LINE
from srprov.trials.reading import Reading, read
from srprov.wire import EngineQuery

_FIRST_PAUSE_S = 0.15
_LONGEST_PAUSE_S = 1.0
_NOT_FOUND = 404

Place = tuple[str, str]
"""Robot and container."""


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """What was seen by now."""

    readings: Mapping[Place, Reading]
    """What was looked at; a container that is not there has an empty state."""
    matched: frozenset[tuple[Place, str]]
    """A container and a pattern that some line of its log matched."""
    read: frozenset[Place]
    """Containers whose logs were read to their end."""
    failed: Mapping[str, str]
    """Robot -> why it is not waited for any more."""


class Watch:
    """Looks until its block ends; each robot has a thread, and each log that matters."""

    def __init__(
        self,
        get: Callable[[str], Session],
        renew: Callable[[str], None],
        places: Mapping[Place, Sequence[str]],
        say: Say,
    ) -> None:
        """Take what is to be looked at.

        Args:
            get: Returns the present session with a robot, or raises TransportError.
            renew: Connects to a robot anew, or raises TransportError.
            places: Container -> patterns that are looked for in its log.
            say: Told who is awaited.
        """
        self._get, self._places = get, places
        self._patience = Patience(renew, say)
        self._lock = threading.Lock()
        self._readings: dict[Place, Reading] = {}
        self._matched: set[tuple[Place, str]] = set()
        self._read: set[Place] = set()
        self._failed: dict[str, str] = {}
        self.news = threading.Event()
        """Set when something else was seen than before."""

    def __enter__(self) -> Watch:
        """Begin to look."""
        for host in sorted({host for host, _ in self._places}):
            threading.Thread(target=self._look_on, args=(host,), name=f"look at {host}", daemon=True).start()
        for place, patterns in self._places.items():
            if patterns:
                threading.Thread(target=self._follow, args=(place, patterns), name="log", daemon=True).start()
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Look no further; threads that wait for a robot end by themselves, or with their connection."""
        self._patience.over.set()

    def seen(self) -> Seen:
        """Return what was seen by now."""
        with self._lock:
            return Seen(
                readings=dict(self._readings),
                matched=frozenset(self._matched),
                read=frozenset(self._read),
                failed=dict(self._failed),
            )

    def _look_on(self, host: str) -> None:
        pause = _FIRST_PAUSE_S
        try:
            while not self._patience.over.is_set():
                found = self._patience.do(self._look, host)
                with self._lock:
                    if any(self._readings.get(place) != reading for place, reading in found.items()):
                        self.news.set()
                    self._readings |= found
                self._patience.over.wait(pause)
                pause = min(pause * 1.5, _LONGEST_PAUSE_S)
        except EquipmentFailed as error:
            with self._lock:
                self._failed[host] = str(error)
            self.news.set()

    def _look(self, host: str) -> dict[Place, Reading]:
        """Read all containers of one robot, in one round trip."""
        places = [place for place in self._places if place[0] == host]
        queries = [EngineQuery(path=f"/containers/{url_quote(name, safe='')}/json") for _, name in places]
        replies = self._get(host).ask(queries)
        for reply in replies:
            if not reply.ok and reply.status != _NOT_FOUND:
                raise EngineAway(why(reply))
        with answers_of(host):
            return {
                place: read(reply.json() if reply.ok else None) for place, reply in zip(places, replies, strict=True)
            }

    def _follow(self, place: Place, patterns: Sequence[str]) -> None:
        """Read a log from its beginning until all patterns were found, again when its container was started again."""
        left = {pattern: compiled(pattern).search for pattern in patterns}
        while left and not self._patience.over.is_set():
            with contextlib.suppress(TransportError):  # whoever looks at the container has the connection made anew
                self._scan(place, left)
            self._patience.over.wait(_LONGEST_PAUSE_S)
            while self._is_over(place) and not self._patience.over.wait(_LONGEST_PAUSE_S):
                pass

    def _scan(self, place: Place, left: dict[str, Callable[[str], object]]) -> None:
        with self._lock:
            self._read.discard(place)
        for line in self._get(place[0]).container_log(place[1], tail=-1, follow=True):
            if self._patience.over.is_set():
                return
            text = line[:LONGEST_LINE]
            for pattern in [pattern for pattern, search in left.items() if search(text)]:
                del left[pattern]
                with self._lock:
                    self._matched.add((place, pattern))
                self.news.set()
            if not left:
                return
        with self._lock:
            self._read.add(place)
        self.news.set()

    def _is_over(self, place: Place) -> bool:
        with self._lock:
            reading = self._readings.get(place)
            return place in self._read and reading is not None and reading.ended
