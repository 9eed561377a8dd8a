"""Something else in the place of a robot's sshd."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

from srprov.definitions.model import Host


@contextlib.contextmanager
def in_place_of_sshd(speak: Callable[[socket.socket], None]) -> Iterator[Host]:
    """Give a robot at whose port `speak` has the first connection, until that is closed from either side."""
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()

        def take() -> None:
            taken, _ = server.accept()
            with taken, contextlib.suppress(OSError):
                speak(taken)

        threading.Thread(target=take, daemon=True).start()
        yield Host(name="r1", address="127.0.0.1", port=server.getsockname()[1], user="root")
