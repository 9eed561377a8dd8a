"""HTTP to a Docker Engine over any pair of byte streams: what requests and urllib3 have to be taught.

Takes a function that dials the engine, returns an adapter for the docker SDK's `APIClient`. The SDK's own
`transport/sshconn.py` opens an SSH connection of its own, knows no deadline and loses what the far end wrote to stderr.
"""

from __future__ import annotations

import weakref
from typing import Any

import requests.adapters
import urllib3
import urllib3.connection

from srprov.session import Traffic
from srprov.transport.engine.link import Dial

MAX_CHANNELS = 4
"""Each may be a session of sshd, whose MaxSessions is 10 by default, and the shells need two."""
_POOL_WAIT_S = 300.0


class _Connection(urllib3.connection.HTTPConnection):
    """One HTTP connection to the engine, kept alive."""

    def __init__(self, dial: Dial) -> None:
        super().__init__("engine")
        self._dial = dial

    def connect(self) -> None:
        timeout = self.timeout if isinstance(self.timeout, (int, float)) else 60.0
        self.sock: Any = self._dial(float(timeout))  # http.client uses no more of a socket than this one has
        self.sock.settimeout(timeout)  # as it is: it may be one of waits alone

    def request(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - as the base class has it
        # A connection that is used again still has the deadline of its last request.
        if self.sock is not None:
            self.sock.settimeout(self.timeout)
        super().request(*args, **kwargs)

    @property
    def is_connected(self) -> bool:
        # The base class selects on fileno(), which costs a paramiko channel two descriptors.
        return self.sock is not None and not self.sock.waiting()


class _Pool(urllib3.HTTPConnectionPool):
    """At most four connections; a fifth request waits for one of them."""

    def __init__(self, dial: Dial) -> None:
        super().__init__("engine", maxsize=MAX_CHANNELS, block=True)
        self._dial = dial
        self._made: weakref.WeakSet[_Connection] = weakref.WeakSet()

    def _new_conn(self) -> _Connection:
        made = _Connection(self._dial)
        self._made.add(made)
        return made

    def abort(self) -> None:
        """Close every connection, also one that waits for an answer: that ends the wait."""
        for one in list(self._made):
            if one.sock is not None:
                one.sock.abort()
        self.close()

    def warm(self, seconds: float) -> None:
        """Open a connection, and keep it for the first request."""
        one: _Connection = self._get_conn()
        try:
            if not one.is_connected:
                one.timeout = seconds
                one.connect()
        finally:
            self._put_conn(one)

    def _get_conn(self, timeout: float | None = None) -> Any:  # noqa: ANN401 - as the base class has it
        return super()._get_conn(timeout=timeout or _POOL_WAIT_S)


class EngineAdapter(requests.adapters.HTTPAdapter):
    """A requests adapter whose only destination is the engine behind `dial`, whatever a URL says."""

    def __init__(self, dial: Dial, traffic: Traffic) -> None:
        """Take how to open a stream, and where to count requests."""
        super().__init__()
        self._pool = _Pool(dial)
        self._traffic = traffic
        self.warm = self._pool.warm

    def get_connection_with_tls_context(self, *_args: object, **_kwargs: object) -> _Pool:
        """Return the one pool; requests calls this since 2.32.2, and `get_connection` before."""
        return self._pool

    get_connection = get_connection_with_tls_context

    def send(self, *args: Any, **kwargs: Any) -> requests.Response:  # noqa: ANN401 - as the base class has it
        """Count and send."""
        self._traffic.round_trips += 1
        return super().send(*args, **kwargs)

    def close(self) -> None:
        """Close every connection, and end every wait for an answer."""
        super().close()
        self._pool.abort()
