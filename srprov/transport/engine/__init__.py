"""The robot's Docker Engine over a byte stream that the session opens: questions by `reads.py`, changes by `client.py`.

`reads.py` sends all questions at once and needs the standard library only. `client.py` is the docker SDK on an adapter
(`adapter.py`) that runs over the same connection; it is imported when something changes. `link.py` has the streams and
their errors, `answers.py` what an engine's words mean.
"""

from __future__ import annotations

import functools
import threading


@functools.lru_cache(maxsize=1)
def preload() -> threading.Thread:
    """Import the docker SDK (0.1 s) in the background, once; only what changes something needs it."""

    def load() -> None:
        import srprov.transport.engine.client

        del srprov

    thread = threading.Thread(target=load, name="import docker", daemon=True)
    thread.start()
    return thread
