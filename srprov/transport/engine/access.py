"""The two ways to the engine of one robot, each made when it is first used.

What only asks does not import the docker SDK.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from srprov.transport.engine.link import Dial, EngineLink
from srprov.wire import Traffic

if TYPE_CHECKING:
    from srprov.transport.engine.client import Engine
    from srprov.transport.engine.reads import EngineReader


class EngineAccess:
    """A robot's Docker Engine, whether it is there or not. Safe for several threads."""

    def __init__(
        self, host: str, traffic: Traffic, alive: Callable[[], bool], dial_reads: Dial, dial_changes: Dial
    ) -> None:
        """Take the robot's name, where to count, how to see that it is gone, and how to open each kind of stream."""
        self._host, self._traffic, self._alive = host, traffic, alive
        self._dial_reads, self._dial_changes = dial_reads, dial_changes
        self._lock = threading.Lock()
        self._reader: EngineReader | None = None
        self._client: Engine | None = None

    def _link(self, dial: Dial) -> EngineLink:
        return EngineLink(host=self._host, dial=dial, alive=self._alive, traffic=self._traffic)

    @property
    def reader(self) -> EngineReader:
        """What asks the engine."""
        with self._lock:
            if self._reader is None:
                from srprov.transport.engine.reads import EngineReader

                self._reader = EngineReader(self._link(self._dial_reads))
            return self._reader

    @property
    def client(self) -> Engine:
        """What changes the engine, and carries images and logs."""
        with self._lock:
            if self._client is None:
                from srprov.transport.engine.client import Engine

                self._client = Engine(self._link(self._dial_changes))
            return self._client

    def warm_client(self) -> None:
        """Import what the client needs, and connect; for a thread of its own."""
        self.client.warm(self.reader.api_version)

    def close(self) -> None:
        """Close every stream; whoever waits for an answer is woken by that."""
        if self._reader is not None:
            self._reader.close()
        if self._client is not None:
            self._client.close()
