"""The robot's Docker Engine over a byte stream that the session opens: questions by `reads.py`, changes by `client.py`.

`EngineAccess` has both, each made when it is first used. `reads.py` sends all questions at once and needs the standard
library only. `client.py` is the docker SDK on an adapter (`adapter.py`) that runs over the same connection; it is
imported when something changes. `link.py` has the streams and their errors, `answers.py` what an engine's words mean.
"""

from __future__ import annotations

import functools
import threading
from typing import TYPE_CHECKING

from srprov.session import no_progress
from srprov.transport.engine.link import EngineLink

if TYPE_CHECKING:
    from srprov.session import Exec
    from srprov.transport.engine.attached import AttachedCommand
    from srprov.transport.engine.client import Engine
    from srprov.transport.engine.reads import EngineReader
    from srprov.wire import EngineCall, Reply


@functools.lru_cache(maxsize=1)
def preload() -> threading.Thread:
    """Import the docker SDK (0.1 s) in the background, once; only what changes something needs it."""

    def load() -> None:
        import srprov.transport.engine.client

        del srprov

    thread = threading.Thread(target=load, name="import docker", daemon=True)
    thread.start()
    return thread


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

    def attach(self, container: str, what: Exec) -> AttachedCommand:
        """Start a command in a container, on a stream of its own; see `session.Session.run_in`."""
        from srprov.transport.engine.attached import AttachedCommand

        def call(change: EngineCall) -> Reply:
            return self.client.call(change, no_progress)

        return AttachedCommand(self._reads, self.reader.ask, call, container, what)

    def warm_client(self) -> None:
        """Import what the client needs, and connect; for a thread of its own."""
        self.client.warm(self.reader.api_version)

    def close(self) -> None:
        """Close every stream; whoever waits for an answer is woken by that."""
        if self._reader is not None:
            self._reader.close()
        if self._client is not None:
            self._client.close()
