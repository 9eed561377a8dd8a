"""The controller's end of a lock: what it believes of the robot's half, by a clock of the test's own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from srprov.errors import TransportError
from srprov.session import Pulse, Traffic
from srprov.transport.shell import lock_channel as channel_file
from srprov.transport.shell.lock_channel import HeartbeatChannel

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
    monkeypatch.setattr(channel_file, "now", lambda: streams.time)
    yield streams
    streams.close()


def test_a_late_first_word_lengthens_no_lock(late: LateStreams) -> None:
    """The robot counts from when it spoke, so what the controller believes may not count from when it heard."""
    channel = HeartbeatChannel("r1", late, Traffic(), PULSE, lambda _error: None)
    channel.open("exec script")
    assert (channel.sshd_pid, channel.first_answer, late.time) == ("4711", "locked", 18.0)
    channel.check()
    late.time = 19.9
    channel.check()
    late.time = 20.1
    with pytest.raises(TransportError, match="no sign of life for 20 s"):
        channel.check()
    channel.cut()


def test_what_is_over_ends_no_process(late: LateStreams) -> None:
    """After the end nobody on the robot would end a stream: there is no process to rely on."""
    channel = HeartbeatChannel("r1", late, Traffic(), PULSE, lambda _error: None)
    channel.open("exec script")
    channel.cut()
    assert channel.sshd_pid == "" and late.ended
