"""The socket that paramiko gets: bytes are counted, taken at once, and given in the pieces that are asked for."""

from __future__ import annotations

import socket
import threading
import time

from srprov.session import Traffic
from srprov.transport.openssh.sockets import CountedSocket


def test_what_came_at_once_is_given_in_pieces() -> None:
    ours, theirs = socket.socketpair()
    traffic = Traffic()
    wire = CountedSocket(ours, traffic)
    theirs.sendall(b"abcdefgh")
    assert [wire.recv(3), wire.recv(3)] == [b"abc", b"def"]
    assert traffic.bytes_received == 8, "all of it was taken"
    theirs.sendall(b"ij")
    theirs.close()
    assert [wire.recv(9), wire.recv(9), wire.recv(9)] == [b"gh", b"ij", b""]
    assert traffic.bytes_received == 10
    wire.close()


def test_it_wakes_seldom_and_at_once_when_it_is_closed() -> None:
    ours, theirs = socket.socketpair()
    wire = CountedSocket(ours, Traffic())
    wire.settimeout(0.1)
    assert ours.gettimeout() == 1.0
    wire.settimeout(7.5)
    assert ours.gettimeout() == 7.5
    wire.settimeout(None)
    assert ours.gettimeout() is None
    heard: list[bytes] = []
    reader = threading.Thread(target=lambda: heard.append(wire.recv(1)), daemon=True)
    reader.start()
    time.sleep(0.1)
    wire.close()
    reader.join(5)
    assert heard == [b""]
    theirs.close()
