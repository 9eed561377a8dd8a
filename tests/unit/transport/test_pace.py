"""Streams of strangers: silence and trickles end all of them alike, and a slow honest radio ends none."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution.collect import CollectFailed, Place, fetch_tar
from srprov.pace import LEAST_RATE, SILENCE_S, Pace
from srprov.transport.image_shell import output, send
from srprov.transport.volume_copy import copy_volume
from srprov.wire import CopyVolume, Query, Reply, Run

SIZE = 400_000
COPY = CopyVolume(volume="srprov.x.d", into="srprov-copy.x.d", source_host="far")


class Clock:
    """A clock that goes only as far as it is told."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        assert self.now < 20_000, "it is waited for without end"
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr("srprov.pace.time", made)
    return made


class Link:
    """The streams of a shell over a link: what it carries, as pairs of seconds to wait and bytes then."""

    def __init__(self, clock: Clock, carries: Iterator[tuple[float, int]], size: int = SIZE, said: bytes = b"") -> None:
        self.clock, self.carries, self.left, self.said, self.may = clock, carries, size, said, 0
        self.ended = False

    def read(self) -> tuple[bytes, bytes]:
        if self.said:
            said, self.said = self.said, b""
            return said, b""
        count, self.may = min(self.may, self.left), 0
        self.left -= count
        over, self.ended = not self.left and not self.ended, not self.left
        return b"x" * count, b"srprov-end 0\n" if over else b""

    def write(self, data: memoryview) -> int:
        count, self.may = min(self.may, len(data)), 0
        return count

    def wait(self, seconds: float, *, writing: bool) -> None:
        self.clock.now += (carried := next(self.carries))[0]
        self.may = carried[1]

    def reason(self) -> str:
        return "it ended"

    def close(self) -> None:
        self.ended = True


class Robot:
    """A robot whose shells are one link."""

    alive = True

    def __init__(self, host: str, link: Any) -> None:
        self.host, self.link = host, link

    def execute(self, command: Run | Query) -> Reply:
        script = getattr(command, "script", "")
        if "sha256sum" in script:
            return Reply(status=0, out="0" * 64)
        return Reply(status=0, out="/dev/vda1 9 1 99999999 1% /" if "df -P" in script else "9000\t/v\n9000\t/v\n3\n")

    def open_shell(self, _script: str) -> Any:
        return self.link

    def do(self, work: Callable[[Any], Any]) -> Any:
        return work(self)


class Fast(Link):
    """The other end of a copy: it takes and says everything at once."""

    def write(self, data: memoryview) -> int:
        self.left -= len(data)
        self.said = b"" if self.left else b"done\n"
        return len(data)


def printed(clock: Clock, carries: Iterator[tuple[float, int]]) -> None:
    assert sum(map(len, output("far", Link(clock, carries)))) == SIZE


def sent(clock: Clock, carries: Iterator[tuple[float, int]]) -> None:
    link, pace = Link(clock, carries), Pace()
    for _ in range(10):
        send("far", link, b"x" * (SIZE // 10), pace)


def fetched(clock: Clock, carries: Iterator[tuple[float, int]]) -> None:
    robot: Any = Robot("far", Link(clock, carries))
    try:
        assert sum(map(len, fetch_tar(robot, Place(root="/v", path="."), (), SIZE))) == SIZE
    except CollectFailed as error:
        raise TransportError("far", str(error), code=Code.LOST) from error


def copied(clock: Clock, carries: Iterator[tuple[float, int]]) -> None:
    source: Any = Robot("far", Link(clock, carries))
    target: Any = Robot("near", Fast(clock, carries, said=b"ready\n"))
    reply = copy_volume(COPY, target, lambda _name: source, lambda _line: None)
    if not reply.ok:
        raise TransportError("far", reply.err, code=Code.LOST)


WAYS = pytest.mark.parametrize("carry", [printed, sent, fetched, copied])
Carry = Callable[[Clock, Iterator[tuple[float, int]]], None]


@WAYS
@pytest.mark.parametrize(
    "each", [(1.0, 0), (1.0, 1), (100.0, 1), (SILENCE_S - 1, 4096), (1.0, LEAST_RATE // 4)],
    ids=["silence", "a byte a second", "a byte now and then", "a page now and then", "too slow"],
)  # fmt: skip
def test_a_stream_that_falls_silent_or_trickles_is_ended(clock: Clock, carry: Carry, each: tuple[float, int]) -> None:
    with pytest.raises(TransportError, match=r"nothing|no more"):
        carry(clock, itertools.chain([(0.1, SIZE // 2)], itertools.repeat(each)))
    assert clock.now <= SILENCE_S + SIZE / LEAST_RATE + 100


@WAYS
def test_a_radio_of_50_kbit_with_its_gaps_is_waited_for(clock: Clock, carry: Carry) -> None:
    carry(clock, itertools.cycle([(0.5, 3125)] * 120 + [(60.0, 0)]))


def test_time_that_another_takes_is_not_the_streams(clock: Clock) -> None:
    pieces = output("far", Link(clock, itertools.repeat((1.0, 50_000))))
    for _ in pieces:
        clock.now += 1000


@pytest.mark.parametrize("carry", [printed, fetched, copied])
def test_complaints_without_end_are_no_content(clock: Clock, carry: Carry, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(self: Link) -> tuple[bytes, bytes]:
        clock.now += 0.01
        if self.said:
            said, self.said = self.said, b""
            return said, b""
        return b"", b"e" * 1000

    monkeypatch.setattr(Link, "read", read)
    with pytest.raises(TransportError):
        carry(clock, itertools.repeat((0.0, 0)))
    assert clock.now <= SILENCE_S + 1
