"""The two ways to the engine of one robot, each made when it is first used.

What only asks does not import the docker SDK.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from srprov.transport.engine.link import EngineLink

if TYPE_CHECKING:
    from srprov.transport.engine.client import Engine
    from srprov.transport.engine.reads import EngineReader


class EngineAccess:
    """A robot's Docker Engine, whether it is there or not. Safe for several threads."""

    def __init__(self, reads: EngineLink, changes: EngineLink) -> None:
        """Take how the engine is reached, for each of the two."""
        self._reads, self._changes = reads, changes
        self._lock = threading.Lock()
        self._reader: EngineReader | None = None
        self._client: Engine | None = None

    @property
    def reader(self) -> EngineReader:
        """What asks the engine."""
        with self._lock:
            if self._reader is None:
                from srprov.transport.engine.reads import EngineReader

                self._reader = EngineReader(self._reads)
            return self._reader

    @property
    def client(self) -> Engine:
        """What changes the engine, and carries images and logs."""
        with self._lock:
            if self._client is None:
                from srprov.transport.engine.client import Engine

                self._client = Engine(self._changes)
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
