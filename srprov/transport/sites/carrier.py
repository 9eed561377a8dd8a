"""Bytes between a socket of this machine and an outpost: each way what is there goes at once, in order.

A call there and back takes as long as the way; what comes meanwhile is gathered and goes with the next one, so that a
long way has larger pieces and not less of them per second.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import TYPE_CHECKING, Any

from srprov.transport.sites.outpost import ASK_S
from srprov.transport.sites.settings import reason

if TYPE_CHECKING:
    from collections.abc import Callable

_PIECE = 1 << 20
_MOST = 8 << 20
"""Bytes that wait to be sent."""
_ANSWER_S = 60.0
"""Without an answer for so long, beyond what was asked for, the outpost is given up."""


class Carrier:
    """The way to one outpost."""

    def __init__(self, actor: Any) -> None:  # noqa: ANN401 - a proxy of Dask's, made at run time
        """Begin to carry."""
        self.socket, self._theirs = socket.socketpair()
        self._actor = actor
        self._change = threading.Condition()
        self._gathered = bytearray()
        self._over = False
        self.why = ""
        """What ended it, to be put behind a sentence; nothing when that was the end of either side."""
        for work in (self._gather, self._send, self._receive):
            threading.Thread(target=self._until_over, args=(work,), name="site", daemon=True).start()

    def hang_up(self) -> None:
        """Carry nothing more; whoever has the other end of the socket sees its end."""
        with self._change:
            self._over = True
            self._change.notify_all()
        with contextlib.suppress(OSError):
            self._theirs.shutdown(socket.SHUT_RDWR)

    def _until_over(self, work: Callable[[], None]) -> None:
        """Do a part of it; whatever ends one ends all. What Dask raises for a worker that is gone has many types."""
        try:
            work()
        except Exception as error:
            if not self._over:
                self.why = f" ({reason(error) or type(error).__name__})"
        self.hang_up()

    def _gather(self) -> None:
        while data := self._theirs.recv(_PIECE):
            with self._change:
                self._change.wait_for(lambda: len(self._gathered) < _MOST or self._over)
                self._gathered += data
                self._change.notify_all()

    def _send(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._gathered or self._over)
                if self._over:
                    return
                data = bytes(self._gathered)
                self._gathered.clear()
                self._change.notify_all()
            self._actor.send(data).result(timeout=_ANSWER_S)

    def _receive(self) -> None:
        while not self._over:
            data = self._actor.receive().result(timeout=ASK_S + _ANSWER_S)
            if data == b"":
                return
            if data is not None:
                self._theirs.sendall(data)
