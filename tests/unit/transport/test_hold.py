"""The controller's half of a hold: what it believes of the robot's half, by a clock of the test's own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from srprov.errors import TransportError
from srprov.transport import hold as hold_file
from srprov.transport.hold import Heartbeat
from srprov.wire import Pulse, Traffic

PULSE = Pulse(beat_s=19.0, controller_s=20.0, robot_s=30)


class LateStreams:
    """Streams of a script whose words take some time to come."""

    ended = False

    def __init__(self, words: bytes, seconds: float) -> None:
        self.words, self.seconds, self.time = words, seconds, 0.0

    def write(self, data: memoryview) -> int:
        """Take everything."""
        return len(data)

    def read(self) -> tuple[bytes, bytes]:
        """Give the words when they are due."""
        if self.time < self.seconds:
            return b"", b""
        words, self.words = self.words, b""
        return words, b""

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Let the time go by."""
        assert not writing
        self.time = min(self.time + seconds, max(self.time, self.seconds))

    def reason(self) -> str:
        """Never needed."""
        return "it ended"

    def close(self) -> None:
        """End."""
        self.ended = True


@pytest.fixture
def late(monkeypatch: pytest.MonkeyPatch) -> Iterator[LateStreams]:
    streams = LateStreams(b"4711\nlocked\n", 18.0)
    monkeypatch.setattr(hold_file, "now", lambda: streams.time)
    yield streams
    streams.close()


def test_a_late_first_word_lengthens_no_hold(late: LateStreams) -> None:
    """The robot counts from when it spoke, so what the controller believes may not count from when it heard."""
    hold = Heartbeat("r1", late, Traffic(), PULSE, lambda _error: None)
    hold.begin("exec script")
    assert (hold.line, hold.first, late.time) == ("4711", "locked", 18.0)
    hold.check()
    late.time = 19.9
    hold.check()
    late.time = 20.1
    with pytest.raises(TransportError, match="no sign of life for 20 s"):
        hold.check()
    hold.cut()


def test_what_is_over_ends_no_process(late: LateStreams) -> None:
    """After the end nobody on the robot would end a stream: there is no process to rely on."""
    hold = Heartbeat("r1", late, Traffic(), PULSE, lambda _error: None)
    hold.begin("exec script")
    hold.cut()
    assert hold.line == "" and late.ended
