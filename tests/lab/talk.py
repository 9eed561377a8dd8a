"""Traffic between containers, and what of it was lost: run by tests in a container's own network, until stdin ends.

    talk.py echo                 answer on TCP and UDP
    talk.py stream ADDRESS       one TCP connection, and UDP beside it, 100 times a second each
    talk.py knock ADDRESS PORT   a new TCP connection again and again

Prints JSON in the end. A gap is the time in seconds between two answers; for the last one, to the end.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import sys
import time

PORT = 7007
EVERY_S = 0.01
PATIENCE_S = 0.2


def ended(wait_s: float, *others: socket.socket) -> tuple[bool, list[socket.socket]]:
    """Wait for so long at most; return whether stdin has ended, and what can be read."""
    ready: list[object] = select.select([sys.stdin, *others], [], [], wait_s)[0]
    return sys.stdin in ready, [one for one in others if one in ready]


def say(line: str) -> None:
    """Tell the test."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def echo() -> dict[str, object]:
    """Answer until the end."""
    listener = socket.create_server(("", PORT))
    datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    datagrams.bind(("", PORT))
    say("ready")
    streams: list[socket.socket] = []
    while True:
        stop, ready = ended(60, listener, datagrams, *streams)
        if stop:
            return {}
        for one in ready:
            if one is listener:
                streams.append(listener.accept()[0])
            elif one is datagrams:
                data, who = datagrams.recvfrom(100)
                datagrams.sendto(data, who)
            else:
                try:
                    data = one.recv(4096)
                    one.sendall(data)
                except OSError:  # the other side ended with something unread
                    data = b""
                if not data:
                    streams.remove(one)


class Gaps:
    """The longest time without an answer."""

    def __init__(self) -> None:
        self.longest, self.count, self.last = 0.0, 0, time.monotonic()

    def answered(self, count: int = 1) -> None:
        """Note answers."""
        now = time.monotonic()
        self.longest, self.last, self.count = max(self.longest, now - self.last), now, self.count + count

    def told(self) -> dict[str, object]:
        """Return what is printed."""
        return {"longest": max(self.longest, time.monotonic() - self.last), "answers": self.count}


def stream(address: str) -> dict[str, object]:
    """Send and count until the end; an error of the connection ends it, too."""
    tcp = socket.create_connection((address, PORT), timeout=10)
    tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.connect((address, PORT))
    gaps, sent, due, error = {tcp: Gaps(), udp: Gaps()}, 0, time.monotonic(), ""
    say("ready")
    while True:
        stop, ready = ended(max(0.0, due - time.monotonic()), tcp, udp)
        if stop or error:
            return {"sent": sent, "error": error, "tcp": gaps[tcp].told(), "udp": gaps[udp].told()}
        try:
            for one in ready:
                gaps[one].answered(len(one.recv(65536)) if one is tcp else bool(one.recv(100)))
            if time.monotonic() >= due:
                sent, due = sent + 1, due + EVERY_S
                tcp.sendall(b".")
                udp.send(b".")
        except OSError as problem:
            error = str(problem)


def knock(address: str, port: int) -> dict[str, object]:
    """Connect again and again; return when it went well and when it did not, in seconds since the epoch."""
    tries: list[tuple[float, bool]] = []
    say("ready")
    while not ended(EVERY_S)[0]:
        began, well = time.time(), False
        with contextlib.suppress(OSError), socket.create_connection((address, port), timeout=PATIENCE_S):
            well = True
        tries.append((time.time() if well else began, well))
    return {"tries": tries}


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["stream", where]:
            say(json.dumps(stream(where)))
        case ["knock", where, number]:
            say(json.dumps(knock(where, int(number))))
        case _:
            say(json.dumps(echo()))
