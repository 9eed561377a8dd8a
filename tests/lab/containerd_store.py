"""A proxy before a robot's engine that says of its store that it is containerd's; all else passes as it is."""

from __future__ import annotations

import contextlib
import re
import socket
import socketserver
import threading
from collections.abc import Iterator
from pathlib import Path

_STATUS = re.compile(rb'"DriverStatus":\[\[.*?\]\]')
_CONTAINERD = b'"DriverStatus":[["driver-type","io.containerd.snapshotter.v1"]]'


@contextlib.contextmanager
def pretending(robot: Path) -> Iterator[None]:
    """Put the proxy before the engine of the robot with this root folder."""
    place, engine = robot / "run/docker.sock", robot / "run/engine.sock"
    place.rename(engine)

    class Connection(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            with socket.socket(socket.AF_UNIX) as there:
                there.connect(str(engine))
                asks = threading.Thread(target=_pump, args=(self.request, there), daemon=True)
                asks.start()
                _pump(there, self.request)
                asks.join(30)

    try:
        with socketserver.ThreadingUnixStreamServer(str(place), Connection) as server:
            server.daemon_threads = True
            threading.Thread(target=server.serve_forever, daemon=True).start()
            yield
            server.shutdown()
    finally:
        engine.replace(place)


def _pump(source: socket.socket, target: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(1 << 20):
            target.sendall(_STATUS.sub(_padded, data))
    with contextlib.suppress(OSError):
        target.shutdown(socket.SHUT_WR)


def _padded(status: re.Match[bytes]) -> bytes:
    """Return another status of the same length: JSON takes any number of blanks."""
    assert len(_CONTAINERD) <= len(status[0])
    return _CONTAINERD.ljust(len(status[0]))
