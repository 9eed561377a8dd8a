"""Files of a container over an engine that is played: what is asked of it, and what it may answer."""

from __future__ import annotations

import base64
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.codes import Code
from srprov.container_files import InContainer
from srprov.definitions.model import Host
from srprov.errors import TransportError, UsageError
from srprov.session import Session
from srprov.transport import connect
from srprov.transport.container_tar import BEGIN
from srprov.transport.engine.link import EngineSocket, WaitInAll
from tests.unit.transport.test_local_session import Answer, PlayedEngine, pytestmark, reply

__all__ = ["pytestmark"]

EMPTY = bytes(512)
"""The beginning of a tar without entries."""
HEADER = "X-Docker-Container-Path-Stat"


def said(**about: object) -> bytes:
    """Return an answer to HEAD, which has no body."""
    text = base64.b64encode(json.dumps({"name": "x", "size": 0, "mtime": "", "linkTarget": "", **about}).encode())
    return f"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n{HEADER}: {text.decode()}\r\n\r\n".encode()


class Mended(PlayedEngine):
    """An engine that is to be asked for files, whatever it answers then."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self.archive = answer
        super().__init__(path, self._mended)

    def _mended(self, request: str, headers: dict[str, str], body: bytes) -> bytes:
        if request.endswith(("/version", "/json")):
            return reply(b'{"Version":"29.5.1"}')
        return self.archive(request, headers, body)


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], Mended]:
    def begin(answer: Answer) -> PlayedEngine:
        monkeypatch.setenv("DOCKER_HOST", f"unix://{tmp_path}/engine.sock")
        return Mended(tmp_path / "engine.sock", answer)

    return begin


@pytest.fixture
def session() -> Iterator[Session]:
    made = connect(Host(name="here", address="localhost", connection="local"))
    yield made
    made.close()


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        (said(mode=0o644, size=7), InContainer(is_file=True, size=7)),
        (said(mode=(1 << 31) | 0o755), InContainer(is_folder=True)),
        (said(mode=(1 << 27) | 0o777, linkTarget="/out"), InContainer(link="/out")),
        (said(mode=(1 << 26) | (1 << 21)), InContainer()),
        (said(mode=0o644, size=-5), InContainer(is_file=True)),
        (b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", None),
    ],
)
def test_an_engine_is_asked_what_is_at_a_path(
    session: Session, play: Callable[[Answer], Mended], answer: bytes, found: object
) -> None:
    engine = play(lambda *_: answer)
    assert session.path_in("srprov.a.b", "/out/a b&c") == found
    assert engine.requests[-1] == "HEAD /v1.41/containers/srprov.a.b/archive?path=%2Fout%2Fa+b%26c"


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n",
        f"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n{HEADER}: no base64!\r\n\r\n".encode(),
        f"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n{HEADER}: W10=\r\n\r\n".encode(),
        b"HTTP/1.1 500 Oh\r\nContent-Length: 0\r\n\r\n",
        b"SSH-2.0-OpenSSH\r\n",
    ],
)
def test_an_answer_without_form_is_told_in_words(
    session: Session, play: Callable[[Answer], Mended], answer: bytes
) -> None:
    play(lambda *_: answer)
    with pytest.raises(TransportError, match="/out cannot be looked at: "):
        session.path_in("c", "/out")


def test_a_tar_comes_and_goes_in_pieces(session: Session, play: Callable[[Answer], Mended]) -> None:
    got: list[tuple[str, bytes]] = []

    def answer(request: str, headers: dict[str, str], body: bytes) -> bytes:
        if request.startswith("GET"):
            return reply(b"t" * 300_000)
        assert (headers["transfer-encoding"], headers["content-type"]) == ("chunked", "application/x-tar")
        got.append((request, body))
        return reply(b"")

    play(answer)
    assert b"".join(session.copy_out("c", "/out")) == b"t" * 300_000
    session.copy_into("c", "/out", iter([EMPTY * 200, b"b"]))
    place = "/v1.41/containers/c/archive?path=%2Fout&noOverwriteDirNonDir=true"
    assert got == [(f"PUT {place}", BEGIN + EMPTY * 200 + b"b")]


def test_a_container_is_looked_at_when_the_tar_has_come(
    session: Session, play: Callable[[Answer], Mended], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was stopped may run by then, and change what the engine finds behind a name."""
    play(lambda *_: reply(b""))
    order: list[str] = []
    files = session._files
    monkeypatch.setattr(session, "_files", lambda container: order.append("looked") or files(container))

    def slow() -> Iterator[bytes]:
        order.append("came")
        yield EMPTY

    session.copy_into("c", "/out", slow())
    assert order == ["came", "looked"]


def test_what_an_engine_refuses_comes_in_its_words(session: Session, play: Callable[[Answer], Mended]) -> None:
    play(lambda *_: reply(b'{"message":"container rootfs is marked read-only"}', "403 Forbidden"))
    with pytest.raises(TransportError, match="/out cannot be written: container rootfs is marked read-only"):
        session.copy_into("c", "/out", iter([EMPTY]))
    with pytest.raises(TransportError, match="/out cannot be read: container rootfs"):
        list(session.copy_out("c", "/out"))


def test_a_file_here_that_cannot_be_read_is_told_as_that(session: Session, play: Callable[[Answer], Mended]) -> None:
    """Not as a fault of the engine's; and the engine is not left with the beginning of a request."""
    engine = play(lambda *_: reply(b""))

    def pieces() -> Iterator[bytes]:
        yield EMPTY
        raise UsageError("it changed while it was read", code=Code.NO_FILE)

    with pytest.raises(UsageError, match="it changed"):
        session.copy_into("c", "/out", pieces())
    session.copy_into("c", "/out", iter([EMPTY]))
    assert engine.connections == 3  # one for questions


def test_an_engine_that_takes_nothing_is_not_waited_for_forever(
    session: Session, play: Callable[[Answer], Mended], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only waits count: neither the time that the user's own disk takes nor a copy that goes on."""
    monkeypatch.setattr("srprov.transport.engine.archive._WAIT_S", 0.5)

    def slow() -> Iterator[bytes]:
        for _ in range(3):
            time.sleep(0.3)
            yield EMPTY

    engine = play(lambda *_: reply(b""))
    session.copy_into("c", "/out", slow())
    engine.trickle = (b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\n", 0.05)
    engine.archive = lambda *_: b""
    began = time.monotonic()
    with pytest.raises(TransportError, match="of /out not all came: the Docker Engine did not answer within"):
        list(session.copy_out("c", "/out"))
    assert time.monotonic() - began < 30


ENDLESS = {
    "trailers": (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n", b"X-More: 1\r\n" * 50),
    "answers before the answer": (b"HTTP/1.1 100 Continue\r\n\r\n", b"HTTP/1.1 100 Continue\r\n\r\n" * 20),
    "a header": (b"HTTP/1.1 200 OK\r\nX-Long: ", b"x" * 50),
    "the length of a piece": (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1;", b"x" * 50),
}


@pytest.mark.parametrize("what", ENDLESS)
@pytest.mark.parametrize("verb", ["cp", "logs"])
def test_what_is_no_content_gives_no_time_back(
    session: Session, play: Callable[[Answer], Mended], monkeypatch: pytest.MonkeyPatch, what: str, verb: str
) -> None:
    """However much of it comes: a robot would be waited for without end, and nothing said so."""
    monkeypatch.setattr("srprov.transport.engine.archive._WAIT_S", 0.5)
    monkeypatch.setattr("srprov.transport.engine.client._LOG_TIMEOUT_S", 0.5)
    engine = play(lambda *_: b"")
    engine.trickle, engine.trickled = (ENDLESS[what][0], 0.005), ENDLESS[what][1]
    begin = time.monotonic()
    with pytest.raises(TransportError, match="did not answer within"):
        list(session.copy_out("c", "/out") if verb == "cp" else session.container_log("c", tail=-1, follow=False))
    assert time.monotonic() - begin < 5


@pytest.mark.parametrize("way", ["read", "read1", "readinto"])
def test_content_gives_time_back_however_http_client_reads_it(way: str) -> None:
    """Which way that is depends on Python's version: a copy over a slow radio must not be cut with some of them."""
    ours, theirs = socket.socketpair()
    stream = EngineSocket(ours, lambda: "", lambda: False)
    stream.settimeout(WaitInAll(0.5))

    def send() -> None:
        for _ in range(100):
            theirs.sendall(b"x" * 100)
            time.sleep(0.01)
        theirs.close()

    threading.Thread(target=send, daemon=True).start()
    reader, got = stream.makefile(), 0
    while True:
        buffer = bytearray(200)
        size = reader.readinto(buffer) if way == "readinto" else len(getattr(reader, way)(200))
        got += size
        if not size:
            break
    ours.close()
    assert got == 10_000
