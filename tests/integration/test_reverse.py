"""Ports that a real sshd forwards back, and the registry behind them, on this machine's loopback."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import paramiko
import pytest

from srprov.session import Session
from srprov.transport import ConnectOptions, connect
from srprov.transport.openssh import reverse
from srprov.transport.openssh.reverse import ForwardRefused, ReverseForwards
from srprov.transport.registry import answer
from srprov.transport.ssh_session import SshSession
from tests.unit.transport.test_registry import an_image

from .sshd import Sshd, usable

pytestmark = pytest.mark.skipif(not usable(), reason="needs root and openssh-server")

QUICK = ConnectOptions(connect_timeout_s=60.0, warm_engine=False, ssh_config=Path("/dev/null"))


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[..., SshSession]]:
    """Give a function that starts an sshd and connects to it."""
    servers: list[Sshd] = []
    sessions: list[Session] = []

    def build(**options: str) -> SshSession:
        servers.append(Sshd(tmp_path / f"sshd{len(servers)}", options).start())
        sessions.append(connect(servers[-1].host(), options=QUICK))
        assert isinstance(sessions[-1], SshSession)
        return sessions[-1]

    yield build
    for session in sessions:
        session.close()
    for server in servers:
        server.stop()


def echo(channel: paramiko.Channel) -> None:
    while data := channel.recv(1 << 16):
        channel.sendall(data)


def listens(port: int) -> bool:
    with socket.socket() as sock:
        return sock.connect_ex(("127.0.0.1", port)) == 0


def said(port: int, words: bytes, seconds: float = 5.0) -> bytes:
    """Return the answer to some words; nothing when the connection is closed at once."""
    with socket.create_connection(("127.0.0.1", port), timeout=seconds) as sock:
        try:
            sock.sendall(words)
            return sock.recv(1 << 16)
        except ConnectionError:
            return b""


def test_a_port_of_the_robots_loopback_leads_here_until_its_context_ends(robot: Callable[..., SshSession]) -> None:
    forwards = robot().connection.forwards
    with forwards.open(echo, 5) as one, forwards.open(lambda channel: channel.sendall(b"other"), 5) as other:
        assert one != other
        assert (said(one, b"hello"), said(other, b"hello")) == (b"hello", b"other")
        assert said(one, b"again") == b"again"
    assert not listens(one) and not listens(other)
    with forwards.open(echo, 5) as later:
        assert said(later, b"hello") == b"hello", "an earlier port's end takes nothing from a later one"


def test_the_port_is_closed_with_the_session(robot: Callable[..., SshSession]) -> None:
    session = robot()
    with session.connection.forwards.open(echo, 5) as port:
        assert listens(port)
        session.close()
        until = time.monotonic() + 60
        while listens(port):
            assert time.monotonic() < until, "the port is still open"
            time.sleep(0.01)


@pytest.mark.parametrize(
    "options", [{"AllowTcpForwarding": "no"}, {"AllowTcpForwarding": "local"}, {"PermitListen": "none"}]
)
def test_an_sshd_that_forbids_it_says_so_and_the_session_lives_on(
    robot: Callable[..., SshSession], options: dict[str, str]
) -> None:
    session = robot(**options)
    with (
        pytest.raises(ForwardRefused, match="AllowTcpForwarding or PermitListen"),
        session.connection.forwards.open(echo, 5),
    ):
        pytest.fail("it was forwarded")
    assert session.alive


def test_an_sshd_that_does_not_answer_is_not_waited_for(
    robot: Callable[..., SshSession], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = robot()
    monkeypatch.setattr(session.connection.transport, "global_request", lambda *_a, **_k: time.sleep(3))
    with (
        pytest.raises(ForwardRefused, match="sshd did not answer"),
        session.connection.forwards.open(echo, 0.2),
    ):
        pytest.fail("it was forwarded")


@pytest.mark.parametrize("port", [0, 1 << 16, (1 << 32) - 1])
def test_a_port_that_cannot_be_is_not_believed(port: int) -> None:
    class Lying:
        def request_port_forward(self, *_arguments: object) -> int:
            return port

    forwards = ReverseForwards(Lying())  # type: ignore[arg-type]  # as much of a transport as is asked
    with pytest.raises(ForwardRefused, match=str(port)), forwards.open(echo, 5):
        pytest.fail("it was believed")


def test_whoever_comes_from_elsewhere_is_not_let_in(robot: Callable[..., SshSession]) -> None:
    with robot(GatewayPorts="yes").connection.forwards.open(echo, 5) as port:
        elsewhere = socket.create_connection(("127.0.0.1", port), timeout=5, source_address=("127.0.0.2", 0))
        with elsewhere, contextlib.suppress(ConnectionError):
            elsewhere.sendall(b"hello")
            assert elsewhere.recv(9) == b""
        assert said(port, b"hello") == b"hello"


def test_more_connections_than_there_is_room_for_are_closed(
    robot: Callable[..., SshSession], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reverse, "_MOST_CHANNELS", 2)
    with robot().connection.forwards.open(echo, 5) as port:
        held = [socket.create_connection(("127.0.0.1", port), timeout=5) for _ in range(2)]
        for sock in held:
            sock.sendall(b"here")
            assert sock.recv(9) == b"here"
        assert said(port, b"hello") == b""
        held.pop().close()
        until = time.monotonic() + 60
        while said(port, b"hello") != b"hello":
            assert time.monotonic() < until, "its room is not free again"
            time.sleep(0.01)
        held.pop().close()


def test_hundreds_of_connections_at_once_leave_the_session_alive(robot: Callable[..., SshSession]) -> None:
    session = robot()
    before = threading.active_count()
    with session.connection.forwards.open(echo, 5) as port:
        flood = [socket.create_connection(("127.0.0.1", port), timeout=5) for _ in range(400)]
        assert threading.active_count() - before < reverse._MOST_CHANNELS + 10
        for sock in flood:
            sock.close()
        until = time.monotonic() + 60
        while said(port, b"hello") != b"hello":
            assert time.monotonic() < until, "nobody answers any more"
            time.sleep(0.01)
    assert session.alive and not listens(port)


def test_a_scan_finds_a_registry_and_404(robot: Callable[..., SshSession], tmp_path: Path) -> None:
    image = an_image(tmp_path / "blobs")
    counted: list[int] = []

    def count(_digest: str, size: int) -> None:
        counted.append(size)

    with robot().connection.forwards.open(lambda channel: answer(channel, image, count), 5) as port:
        for path in ("/", "/v2/_catalog", f"/v2/image/blobs/{image.layers[0].compressed}"):
            asked = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            asked.request("GET", path)
            assert asked.getresponse().status == 404
            asked.close()
        assert counted == []
        asked = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
        asked.request("GET", f"/v2/{image.name}/manifests/{image.digest}")
        assert asked.getresponse().read() == image.manifest
        asked.close()
