"""What the other process may call here: robots of other processes, turns among them, and files of this machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from srprov.session import Session, no_progress
from srprov.transport.data_copy import found_here
from srprov.transport.turns import OwnTurns
from srprov.wire import SendData

if TYPE_CHECKING:
    from srprov.transport.options import ConnectOptions

_LOOK_S = 1.0
"""How often who waits for a turn looks whether the other process is still there."""
_PIECE = 1 << 20


class Home:
    """This end, for one other process."""

    def __init__(
        self, get: Callable[[str], Session], own: Callable[[str], bool], turns: OwnTurns, options: ConnectOptions
    ) -> None:
        """Take what gives the session of any robot, which of them are the other process's own, and who gives turns."""
        self._get, self._own, self._turns, self._options = get, own, turns, options
        self._lock = threading.Lock()
        self._taken: set[str] = set()
        self._gone = threading.Event()

    def peer(self, host: str) -> Session | None:
        """Wait until a robot is connected; return its session, or None when the process that asks has it."""
        session = self._get(host)
        return None if self._own(host) else session

    def layer(self, digest: str) -> Iterator[bytes] | None:
        """Return a content of this machine's cache of layers, compressed by gzip; None when it is not there."""
        blob = self._options.image_sources.blobs.get(digest)
        return None if blob is None else blob.pieces()

    def data_set(self, command: SendData) -> Iterator[bytes]:
        """Return the content of a data set of this machine, downloaded if need be.

        Raises:
            ValueError: There is none.
            OSError: It cannot be read or downloaded.
        """
        with found_here(command, self._options.turns, no_progress).open("rb") as file:
            while piece := file.read(_PIECE):
                yield piece

    def take_turn(self, key: str) -> None:
        """Let the other process get a content alone."""
        turn = self._turns.turn(key)
        while not turn.acquire(timeout=_LOOK_S):
            if self._gone.is_set():
                return
        with self._lock:
            self._taken.add(key)
        if self._gone.is_set():
            self.give_turn(key)

    def give_turn(self, key: str) -> None:
        """Let the next one."""
        with self._lock:
            if key not in self._taken:
                return  # it was given when the process ended
            self._taken.remove(key)
        self._turns.turn(key).release()

    def gone(self) -> None:
        """Let the next one in everything that the other process had."""
        self._gone.set()
        with self._lock:
            taken = list(self._taken)
        for key in taken:
            self.give_turn(key)
