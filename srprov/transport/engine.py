"""What changes the Docker Engine of one robot, by the docker SDK's `APIClient` over the robot's own connection.

Takes `EngineCall`s and image streams, gives replies; `engine_reads.py` has the questions. An engine that is not there
is a reply with status 0 and the reason in words, not an exception. The API version is the lower one of the engine's
and the SDK's; a robot's docker CLI may be newer than its engine, so the CLI is never asked.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import requests
import urllib3.exceptions
from docker import APIClient
from docker.constants import DEFAULT_DOCKER_API_VERSION, MINIMUM_DOCKER_API_VERSION

from srprov.errors import TransportError
from srprov.transport.deadline import Deadline
from srprov.transport.engine_http import EngineAdapter, root_cause
from srprov.transport.engine_stream import Dial, EngineGone
from srprov.transport.engine_text import demultiplex, follow, lines, message_of, quoted
from srprov.wire import EngineCall, Progress, Reply, Traffic

_BASE = "http+docker://engine"
_PING_TIMEOUT_S = 20.0
_LOG_TIMEOUT_S = 60.0
_CHUNK = 1 << 20
_LOG_CHUNK = 64 * 1024
_FAILURES = (requests.RequestException, urllib3.exceptions.HTTPError, OSError, EOFError)


class Engine:
    """One robot's engine. Threads may use it at the same time; a long build does not hold up a question."""

    def __init__(self, host: str, dial: Dial, traffic: Traffic, alive: Callable[[], bool]) -> None:
        """Take the robot's name, how to open a stream, where to count, and how to see that the robot is gone."""
        self._host = host
        self._alive = alive
        self._adapter = EngineAdapter(dial, traffic)
        self._starting = threading.Lock()
        self._client: APIClient | None = None
        self._version = ""

    def warm(self, api_version: str = "") -> None:
        """Connect and agree on a version; for a thread of its own, so that the first question finds it done.

        An engine whose version is known from what it answered to somebody else is only connected to.
        """
        with contextlib.suppress(*_FAILURES):  # whoever asks first gets the reason
            self._ready(api_version)

    def close(self) -> None:
        """Close every connection to the engine."""
        self._adapter.close()

    def call(self, call: EngineCall, progress: Progress) -> Reply:
        """Send a request that changes something; a stream's lines go to `progress`.

        Raises:
            TransportError: The robot, not only its engine, is gone.
        """
        data: Any = call.blob or call.body.encode("utf-8")
        kind = "application/x-tar" if call.blob else "application/json"
        return self._post(call, data, {"Content-Type": kind} if data else {}, progress)

    def load(self, chunks: Iterator[bytes], timeout_s: float, progress: Progress) -> Reply:
        """Load an image from the chunks of a `docker save`, as they come.

        Raises:
            TransportError: The robot is gone, or the chunks' source is.
        """
        call = EngineCall(
            method="POST",
            path="/images/load",
            params=(("quiet", "1"),),
            stream=True,
            accept=(200,),
            timeout_s=timeout_s,
        )
        return self._post(call, chunks, {"Content-Type": "application/x-tar"}, progress)

    def _post(self, call: EngineCall, data: Any, headers: dict[str, str], progress: Progress) -> Reply:  # noqa: ANN401
        """Send a request with a body and judge the answer."""
        try:
            with self._send(call.method, call.path, dict(call.params), call.timeout_s, data, headers) as response:
                if response.status_code in call.accept and call.stream:
                    return follow(response, progress)
                text = response.content.decode("utf-8", "replace")
                ok = response.status_code in call.accept
                return Reply(status=response.status_code, out=text, err="" if ok else message_of(text), ok=ok)
        except _FAILURES as error:
            return self._unreachable(error, call.timeout_s)

    def save(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream an image as `docker save` writes it, in pieces of about 1 MiB.

        Raises:
            TransportError: The engine does not have it, or went away.
        """
        try:
            with self._send("GET", f"/images/{image}/get", {}, timeout_s) as response:
                if response.status_code != 200:
                    why = message_of(response.content.decode("utf-8", "replace"))
                    raise TransportError(
                        self._host, f"its engine cannot give {image}: {why}", hint="is it still there?"
                    )
                yield from response.iter_content(_CHUNK)
        except _FAILURES as error:
            why = self._unreachable(error, timeout_s).err
            raise TransportError(self._host, f"its engine stopped giving {image}: {why}", hint="try again") from error

    def log(self, container: str, *, tail: int, follow: bool) -> Iterator[str]:
        """Give a container's log line by line; with `follow` until the container ends. A negative tail is all of it.

        Raises:
            TransportError: There is no such container, or the engine or the robot went away.
        """
        params = {
            "stdout": "1",
            "stderr": "1",
            "tail": str(tail) if tail >= 0 else "all",
            "follow": "1" if follow else "0",
        }
        try:
            with self._send("GET", f"/containers/{container}/logs", params, _LOG_TIMEOUT_S, endless=follow) as response:
                if response.status_code != 200:
                    why = message_of(response.content.decode("utf-8", "replace"))
                    raise TransportError(
                        self._host, f"no log of {container}: {why}", hint="srprov status lists what is there"
                    )
                yield from lines(demultiplex(response.raw.stream(_LOG_CHUNK)))
        except _FAILURES as error:
            why = self._unreachable(error, _LOG_TIMEOUT_S).err
            raise TransportError(self._host, f"the log of {container} ended: {why}", hint="try again") from error

    def _send(
        self,
        method: str,
        path: str,
        params: dict[str, str],
        timeout_s: float,
        data: Any = None,  # noqa: ANN401 - bytes, or an iterator of them
        headers: dict[str, str] | None = None,
        *,
        endless: bool = False,
    ) -> requests.Response:
        """Send one request and give its response, not yet read.

        The timeout is for sending, and again for all of the answer, unless that is `endless`.
        """
        deadline = Deadline(timeout_s)
        client = self._ready()
        left = deadline.left(0.05)
        return client.request(
            method, f"{_BASE}/v{self._version}{quoted(path)}", params=params, data=data, headers=headers or {},
            timeout=(left, None if endless else left), stream=True, allow_redirects=False,
        )  # fmt: skip

    def _ready(self, api_version: str = "") -> APIClient:
        """Give the client, after agreeing on a version; the engine is asked for its own unless that is known."""
        with self._starting:
            if self._client is None:
                # A version that is given spares the SDK's own request for it, which would go to this machine's engine.
                client = APIClient(base_url="tcp://127.0.0.1:1", version=MINIMUM_DOCKER_API_VERSION)
                client.trust_env = False  # no proxy and no .netrc of this machine's user
                client.mount("http+docker://", self._adapter)
                # One connection before any other request may open a second: sshd's MaxSessions may allow no more.
                if api_version:
                    self._adapter.warm(_PING_TIMEOUT_S)
                else:
                    with client.get(f"{_BASE}/_ping", timeout=_PING_TIMEOUT_S, allow_redirects=False) as answer:
                        api_version = answer.headers.get("Api-Version", "")
                self._version = negotiated(api_version)
                self._client = client
            return self._client

    def _unreachable(self, error: BaseException, seconds: float) -> Reply:
        """Give the reply for an engine that does not answer, or raise when the whole robot is gone."""
        if not self._alive():
            raise TransportError(
                self._host, "the connection was lost", hint="is the robot up, and its network?"
            ) from error
        cause = root_cause(error)
        if isinstance(cause, (TimeoutError, requests.Timeout)):
            return Reply(status=0, ok=False, err=f"the Docker Engine did not answer within {seconds:g} s")
        return Reply(status=0, ok=False, err=" ".join(str(cause).split()) or "the Docker Engine closed the connection")


def negotiated(engine: str) -> str:
    """Give the API version that both sides speak.

    Raises:
        EngineGone: The engine is older than the SDK can speak to, or names no version.
    """
    try:
        theirs = tuple(int(part) for part in engine.split("."))
    except ValueError:
        raise EngineGone(f"what answers is no Docker Engine (Api-Version {engine!r})") from None
    ours, least = (tuple(map(int, v.split("."))) for v in (DEFAULT_DOCKER_API_VERSION, MINIMUM_DOCKER_API_VERSION))
    if theirs < least:
        raise EngineGone(f"the Docker Engine is too old: API {engine}, needed is {MINIMUM_DOCKER_API_VERSION}")
    return ".".join(map(str, min(ours, theirs)))
