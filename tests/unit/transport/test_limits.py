"""What a robot may say has a length and a time: what is beyond is that robot's failure, said in words."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.definitions.model import Host
from srprov.errors import ConnectError, DeadlineError, TransportError
from srprov.session import Pulse, Session, Traffic
from srprov.transport import connect
from srprov.transport.deadline import Deadline
from srprov.transport.engine.answers import demultiplexed, follow, lines
from srprov.transport.openssh.limits import BoundedPacketizer, Flooded, feed
from srprov.transport.shell import frames
from srprov.transport.shell.frames import Frames
from srprov.transport.shell.lock_channel import HeartbeatChannel
from srprov.transport.shell.startup import wait_ready
from srprov.wire import EngineQuery, Query, Run
from tests.impostors import in_place_of_sshd

NONCE = "0123456789abcdef" * 2
MIB = 1 << 20
root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, as the shell is root's")


@pytest.fixture
def session() -> Iterator[Session]:
    made = connect(Host(name="here", address="localhost", connection="local"))
    yield made
    made.close()


@dataclasses.dataclass
class Endless:
    """Streams of a shell that never stops to talk, in pieces, each after a pause."""

    piece: bytes
    pause_s: float = 0.0
    said: int = 0
    ended: bool = False

    def write(self, data: memoryview) -> int:
        """Take everything."""
        return len(data)

    def read(self) -> tuple[bytes, bytes]:
        """Give a piece."""
        time.sleep(self.pause_s)
        self.said += len(self.piece)
        return self.piece, b""

    def wait(self, seconds: float, *, writing: bool) -> None:
        """There is always something."""

    def reason(self) -> str:
        """Never needed."""
        return "it ended"

    def close(self) -> None:
        """End."""
        self.ended = True


# --- the shell ----------------------------------------------------------------------------------------------------


@root
def test_an_answer_without_end_is_the_robot_s_failure(session: Session) -> None:
    began = time.monotonic()
    with pytest.raises(TransportError, match="more than 16 MiB where answers were expected") as caught:
        session.ask([Query(command="cat /dev/zero", timeout_s=20), Query(command="echo never")])
    assert caught.value.host == "here" and time.monotonic() - began < 15


@root
@pytest.mark.parametrize("stream", ["", " >&2"])
def test_a_trickle_does_not_outlast_an_answer_s_time(session: Session, stream: str) -> None:
    began = time.monotonic()
    with pytest.raises(DeadlineError, match=r"no answer within 0\.5 s"):
        session.ask([Query(command=f"while :; do printf x{stream}; sleep 0.05; done", timeout_s=0.5)])
    assert time.monotonic() - began < 15


@root
def test_answers_at_the_last_moment_do_not_add_up_to_hours(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """All other robots would wait for that one."""
    monkeypatch.setattr("srprov.transport.shell.shell.BATCH_S", 0.4)
    began = time.monotonic()
    with pytest.raises(DeadlineError, match=r"no answer within 0\.9 s"):
        session.ask([Query(command=f"sleep 0.2; echo {n}", timeout_s=0.5) for n in range(50)])
    assert time.monotonic() - began < 8


@root
def test_a_script_may_print_any_amount_of_which_the_end_is_kept(session: Session) -> None:
    seen: list[str] = []
    script = (
        "i=0; while [ $i -lt 30 ]; do head -c 1048576 /dev/zero | tr '\\0' x; echo; i=$((i+1)); done; echo end; exit 3"
    )
    reply = session.execute(Run(script=script), seen.append)
    assert (reply.status, reply.out[-4:]) == (3, "end\n") and len(reply.out) < 5 * MIB
    assert seen[-1] == "end" and max(map(len, seen)) <= 4096


def test_a_boundary_without_end_is_refused() -> None:
    answer = Frames(NONCE, 1)
    answer.feed(f"\n{NONCE} begin 0\n".encode())
    with pytest.raises(ValueError, match="does not end"):
        answer.feed(f"\n{NONCE} {'0' * 1000}".encode())


@pytest.mark.parametrize("status", ["", "x", "9" * 40, "-1", "1 2"])
def test_a_status_that_is_none_is_refused_in_words(status: str) -> None:
    with pytest.raises(ValueError, match="the robot's shell answered"):
        Frames(NONCE, 1).feed(f"\n{NONCE} begin 0\n\n{NONCE} 0 {status}\n".encode())


def test_noise_before_the_first_boundary_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "LONGEST", MIB)
    noisy = Frames(NONCE, 1, only_end=True)
    with pytest.raises(ValueError, match="more than 1 MiB"):
        for _ in range(20):
            noisy.feed(b"x" * 100_000)


# --- the login and the lock ---------------------------------------------------------------------------------------


def test_a_login_that_never_stops_to_talk_is_refused() -> None:
    streams = Endless(b"welcome\n" * 10_000)
    with pytest.raises(ConnectError, match="printed more than 1 MiB before the shell was ready"):
        wait_ready("r1", streams, NONCE, Deadline(20), user="u", password=None)
    assert streams.ended and streams.said < 2 * MIB


def test_a_login_that_trickles_is_late() -> None:
    with pytest.raises(DeadlineError, match="not ready within"):
        wait_ready("r1", Endless(b".", 0.02), NONCE, Deadline(0.3), user="u", password=None)


@pytest.mark.parametrize(("piece", "pause_s", "words"), [(b"x" * 5000, 0, "16 KiB"), (b"x", 0.02, "no sign of life")])
def test_a_lock_that_says_no_line_is_lost(piece: bytes, pause_s: float, words: str) -> None:
    """Neither half a line without end, nor one that comes letter by letter, is a sign of life."""
    pulse = Pulse(beat_s=0.1, controller_s=0.3, robot_s=30)
    channel = HeartbeatChannel("r1", Endless(piece, pause_s), Traffic(), pulse, lambda _error: None)
    began = time.monotonic()
    with pytest.raises(TransportError, match=words):
        channel.open("exec script")
    assert time.monotonic() - began < 15


# --- sshd ---------------------------------------------------------------------------------------------------------


class Wire:
    """A socket that has bytes for ever."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def recv(self, size: int) -> bytes:
        """Give some of the first bytes, then zeros."""
        piece, self.data = self.data[:size], self.data[size:]
        return piece or b"\0" * size


def test_a_banner_without_end_is_refused() -> None:
    with pytest.raises(Flooded, match="64 KiB before its SSH banner"):
        BoundedPacketizer(Wire(b"")).readline(5)


def test_a_packet_of_four_gib_is_refused_before_it_is_read() -> None:
    with pytest.raises(Flooded, match="a packet of 429496"):
        BoundedPacketizer(Wire(b"\xff\xff\xff\xf4" + b"\0" * 4)).read_message()


def test_data_beyond_a_channel_s_window_is_refused() -> None:
    channel: Any = SimpleNamespace(in_buffer=bytearray(), in_stderr_buffer=b"", in_window_size=MIB)
    channel._feed = channel.in_buffer.extend
    with pytest.raises(Flooded, match="whose window is 1024 KiB"):
        for _ in range(100):
            feed(channel, b"x" * 32_768)
    assert len(channel.in_buffer) < 2 * MIB


def test_whatever_listens_in_the_place_of_an_sshd_is_a_robot_that_cannot_be_reached() -> None:
    """It never ends its first line, and is named with what it did; nothing of it stays in memory."""

    def speak(taken: socket.socket) -> None:
        for _ in itertools.count():
            taken.sendall(b"x" * 4096)

    with in_place_of_sshd(speak) as host, pytest.raises(ConnectError, match="64 KiB before its SSH banner"):
        connect(host)


# --- the engine ---------------------------------------------------------------------------------------------------


@root
def test_an_engine_that_takes_its_time_for_each_answer_is_not_asked_for_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it has not answered by then counts as not answered; what came stays."""
    monkeypatch.setattr("srprov.transport.engine.reads.BATCH_S", 0.4)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "docker.sock"))
        server.listen()

        def speak() -> None:
            with contextlib.suppress(OSError):
                taken, _ = server.accept()
                while taken.recv(MIB):
                    for _ in range(50):
                        time.sleep(0.2)
                        taken.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}")

        threading.Thread(target=speak, daemon=True).start()
        monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/docker.sock")
        made = connect(Host(name="here", address="localhost", connection="local"))
        began = time.monotonic()
        replies = made.ask([EngineQuery(path=f"/{n}", timeout_s=0.5) for n in range(50)])
        made.close()
    assert time.monotonic() - began < 8
    assert replies[0].ok and replies[0].out == "{}" and "did not answer within" in replies[-1].err


def test_a_line_of_a_million_pieces_is_joined_in_linear_time() -> None:
    began = time.monotonic()
    assert [len(line) for line in lines(b"x" for _ in range(MIB))] == [MIB]
    assert time.monotonic() - began < 10


def test_a_log_of_many_small_frames_is_read_in_linear_time() -> None:
    frame = b"\1\0\0\0\0\0\0\2x\n"
    log = iter([frame * 6553] * 40)
    began = time.monotonic()
    read: Any = SimpleNamespace(read1=lambda _size: next(log, b""))
    assert sum(1 for _ in lines(demultiplexed(read))) == 40 * 6553
    assert time.monotonic() - began < 10


def test_a_build_that_prints_long_lines_says_it_in_short() -> None:
    long = b'{"stream": "' + b"y" * 900_000 + b'"}\n'
    said: list[str] = []
    reply = follow([long, long, b'{"error": "' + b"z" * 900_000 + b'"}\n'], 200, said.append)
    assert not reply.ok and len(reply.out) + len(reply.err) < 10_000 and max(map(len, said)) < 2100
    assert reply.err.endswith("characters more)")
