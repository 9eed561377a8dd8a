"""Logs of many containers -> their lines in the order of their times, as they come.

Takes a Source for each container and what is wanted of it; gives lines, and what was lost. A thread reads each log. A
line waits a moment for those of other robots that are older, but for no robot that is silent.
"""

from __future__ import annotations

import heapq
import re
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence

import msgspec

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.secret import redact_lines
from srprov.session import Session
from srprov.trials.reading import engine_time, read
from srprov.wire import EngineQuery

MOST_BYTES = 1 << 30
"""Of one log that is not followed; whoever wants more asks for a later part."""
_HELD = 256 * 1024
"""Characters of one log that wait to be printed; a line may be longer."""
_BEGINNING_S, _SILENT_S = 1.0, 0.3
"""How long a line waits for other logs that are followed: when all begin, and later."""
_READING_S = 2.0
"""How long it waits for others that are read up to their end."""
_REFILL_S = 0.05
"""How long others wait for one whose lines were just taken."""
_IDLE_S = 0.2
_AGAIN_S = 0.5
"""Between looks at a container whose log ended, and before it is asked for again."""
_LOOKS = 2
_BATCH = 1000
_LINE = 100
"""Characters that a line counts for more than it has, so that empty ones have an end too."""
_SENT = 40
"""Bytes that an engine sends for a line beside its text: its time, and a header."""
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT[\d:.]{8,18}(?:Z|[+-]\d\d:\d\d)) ?", re.ASCII)


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """One container."""

    label: str
    service: str
    host: str
    container: str
    session: Session
    ahead_s: float = 0.0
    """How far its engine's clock is ahead of ours, as far as that is worth a correction."""


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """What is wanted of all logs."""

    tail: int
    """Lines from the end; negative: all."""
    follow: bool = False
    since: float | None = None
    """Seconds since the epoch, by our clock."""


class LogLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line."""

    source: Source
    time: str
    """As the engine says it; empty when it says none."""
    text: str


class LogLost(msgspec.Struct, frozen=True, kw_only=True):
    """A log that cannot be read any more; the others go on."""

    source: Source
    why: str


class MergedLogs:
    """Several logs under way; a context manager that lets all threads go at its end."""

    def __init__(self, sources: Sequence[Source], wanted: Wanted) -> None:
        """Begin to read all of them."""
        self._sources, self._wanted = sources, wanted
        self._changed = threading.Condition()
        self._held: list[deque[tuple[float, float, LogLine]]] = [deque() for _ in sources]
        """For each source: where a line belongs in time, when it came, and itself."""
        self._characters = [0] * len(sources)
        self._first: list[tuple[float, int]] = []
        """A heap of where the first line of each source that has one belongs."""
        self._began = time.monotonic()
        self._open = set(range(len(sources)))
        self._silent = dict.fromkeys(self._open, self._began)
        """Sources that are open and have no line here -> since when."""
        self._lost: dict[int, LogLost] = {}
        self._over = False
        for number in range(len(sources)):
            threading.Thread(target=self._read, args=(number,), name=f"log {number}", daemon=True).start()

    def __enter__(self) -> MergedLogs:
        """Return itself."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Let the threads go; what their sessions say from now on is told to nobody."""
        with self._changed:
            self._over = True
            self._changed.notify_all()

    def all(self) -> Iterator[list[LogLine | LogLost]]:
        """Return what came, until all logs have ended; an empty list, now and then, while nothing comes."""
        while True:
            with self._changed:
                some: list[LogLine | LogLost] = [*self._due()]
                some += [self._lost.pop(number) for number in sorted(self._lost) if not self._held[number]]
                if not some:
                    if not self._open and not self._first:
                        return
                    self._changed.wait(self._pause())
            yield some

    def _due(self) -> list[LogLine]:
        """Take the lines that need not wait any longer."""
        found: list[LogLine] = []
        now = time.monotonic()
        while self._first and len(found) < _BATCH and (not self._silent or now >= self._patient_until()):
            _, number = heapq.heappop(self._first)
            held = self._held[number]
            line = held.popleft()[2]
            self._characters[number] -= len(line.text) + _LINE
            if held:
                heapq.heappush(self._first, (held[0][0], number))
            elif number in self._open:
                self._silent[number] = now
            found.append(line)
        if found:
            self._changed.notify_all()
        return found

    def _patient_until(self) -> float:
        """Return until when the first line waits for those that are silent."""
        latest = max(self._silent.values())
        if not self._wanted.follow:
            return latest + _READING_S
        came = self._held[self._first[0][1]][0][1]
        return max(came + _SILENT_S, self._began + _BEGINNING_S, latest + _REFILL_S)

    def _pause(self) -> float:
        if not self._first:
            return _IDLE_S
        return min(_IDLE_S, max(0.001, self._patient_until() - time.monotonic())) if self._silent else 0.0

    def _read(self, number: int) -> None:
        """Read one log to its end; what ends it is told unless nobody listens any more."""
        source, before = self._sources[number], 0.0
        try:
            for line in _lines(source, self._wanted):
                before = max(before, engine_time(line.time) - source.ahead_s if line.time else before)
                if not self._hold(number, before, line):
                    return
        except TransportError as error:
            with self._changed:
                self._lost[number] = LogLost(source=source, why=error.message)
        finally:
            with self._changed:
                self._open.discard(number)
                self._silent.pop(number, None)
                self._changed.notify_all()

    def _hold(self, number: int, when: float, line: LogLine) -> bool:
        """Keep a line until it is taken, when there is room; return whether somebody still wants it."""
        with self._changed:
            while self._characters[number] > _HELD and not self._over:
                self._changed.wait()
            if not self._held[number]:
                heapq.heappush(self._first, (when, number))
            self._held[number].append((when, time.monotonic(), line))
            self._characters[number] += len(line.text) + _LINE
            self._silent.pop(number, None)
            self._changed.notify_all()
            return not self._over


def _lines(source: Source, wanted: Wanted) -> Iterator[LogLine]:
    """Return the lines of one log, without secrets; with `follow` also of a container that is started again."""
    tail, since = wanted.tail, "" if wanted.since is None else f"{max(0.0, wanted.since + source.ahead_s):.6f}"
    left = MOST_BYTES
    while True:
        last = ""
        for line in _redacted(source, tail, since, wanted.follow):
            yield line
            last, left = line.time or last, left - len(line.text) - _SENT
            if left < 0 and not wanted.follow:
                raise TransportError(
                    source.host, f"its log has more than {MOST_BYTES >> 20} MiB; ask with --since", code=Code.ANSWER
                )
        if not wanted.follow or not _goes_on(source):
            return
        tail, since = (-1, after(last)) if last else (tail, since)


def _redacted(source: Source, tail: int, since: str, follow: bool) -> Iterator[LogLine]:
    """Return the lines of a log, as far as the engine gives it at once."""
    times: deque[str] = deque()
    """Of the lines that are not yet given."""

    def texts() -> Iterator[str]:
        log = source.session.container_log(source.container, tail=tail, follow=follow, times=True, since=since)
        for line in log:
            match = _TIME.match(line)
            times.append(match[1] if match else "")
            yield line[match.end() :] if match else line

    for text in redact_lines(texts(), live=True):
        yield LogLine(source=source, time=times.popleft(), text=text)


def _goes_on(source: Source) -> bool:
    """Return whether a container whose log ended was started again, or will be; a restart by hand takes a moment."""
    for _ in range(_LOOKS):
        time.sleep(_AGAIN_S)
        (reply,) = source.session.ask([EngineQuery(path=f"/containers/{source.container}/json")])
        if reply.ok and read(reply.json()).state in ("running", "restarting"):
            return True
    return False


def after(stamp: str) -> str:
    """Return the moment right after an engine's time, as engines take it: seconds, a dot, nanoseconds."""
    whole = int(engine_time(re.sub(r"\.\d+", "", stamp)))
    fraction = re.search(r"\.(\d{1,9})", stamp)
    nanoseconds = int(fraction[1].ljust(9, "0")) if fraction else 0
    return f"{whole + (nanoseconds + 1) // 10**9}.{(nanoseconds + 1) % 10**9:09d}"
