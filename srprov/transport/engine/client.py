"""What changes the Docker Engine of one robot: the docker SDK's `APIClient` over the robot's own connection.

Takes `EngineCall`s and image streams, returns replies; `reads.py` has the questions. An engine that is not there is a
reply with status 0 and the reason in words, not an exception. The API version is the lower one of the engine's and the
SDK's; a robot's docker CLI may be newer than its engine, so the CLI is never asked.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Iterator
from typing import Any

import requests
import urllib3.exceptions
from docker import APIClient
from docker.constants import DEFAULT_DOCKER_API_VERSION, MINIMUM_DOCKER_API_VERSION
from docker.errors import DockerException, InvalidConfigFile

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.session import Progress
from srprov.transport.engine.adapter import EngineAdapter
from srprov.transport.engine.answers import demultiplexed, follow, lines, message_of, quoted, within
from srprov.transport.engine.link import EngineGone, EngineLink, WaitInAll
from srprov.transport.engine.timed_log import timed_lines
from srprov.wire import EngineCall, Reply

_HERE = "tcp://engine:2375"
"""Any address that the SDK accepts: the adapter has one destination only."""
_PING_TIMEOUT_S = 20.0
_LOG_TIMEOUT_S = 60.0
_CHUNK = 1 << 20
_PROGRESS_PIECE = 64 * 1024
_LONGEST_ANSWER = 8 << 20
_FAILURES = (
    EngineGone, DockerException, requests.RequestException, urllib3.exceptions.HTTPError, OSError, EOFError,
)  # fmt: skip


class Refused(Exception):
    """The engine answered, with a status that is no success."""

    def __init__(self, response: requests.Response) -> None:
        """Read why."""
        super().__init__(response)
        self.status = response.status_code
        self.text = _text(response)

    @property
    def message(self) -> str:
        """The engine's own words."""
        return message_of(self.text)


class _Client(APIClient):
    """The SDK's client for one request, and its answer: the SDK leaves one open that is not read to its end."""

    def __init__(self, adapter: EngineAdapter, version: str, timeout_s: float) -> None:
        # A version that is given spares the SDK's own request for it.
        try:
            super().__init__(base_url=_HERE, version=version, timeout=timeout_s)  # type: ignore[arg-type]  # any number
        except (AttributeError, TypeError, ValueError, InvalidConfigFile) as error:
            # the SDK reads it whether it is needed or not, and expects nothing else than a right one
            raise EngineGone(f"config.json of Docker on this machine cannot be read: {error}") from error
        # nothing of this machine's user goes to a robot: no headers of ~/.docker/config.json, no proxy, no .netrc
        self._general_configs: dict[str, Any] = {}
        self.trust_env = False
        self.headers["Accept-Encoding"] = "identity"  # what a few bytes would become in memory has no limit
        self.mount("http://", adapter)
        self.mount("https://", adapter)
        self.hooks["response"] = [self._received]
        self.answer = requests.Response()

    def _received(self, response: requests.Response, **_options: object) -> None:
        """Keep the answer; judge it here, as the SDK takes some errors for success, and follows redirections."""
        self.answer = response
        if response.headers.get("Content-Encoding", "identity") != "identity":
            raise EngineGone("its answer is compressed, which nobody asked for")
        if not 200 <= response.status_code < 300:
            raise Refused(response)

    def send_call(self, method: str, path: str, **options: Any) -> requests.Response:  # noqa: ANN401 - as requests has it
        """Send a request to a path of the engine's API; its answer is not read yet."""
        url = f"{self.base_url}/v{self.api_version}{quoted(path)}"
        return self.request(method, url, stream=True, **{"timeout": self.timeout, **options})

    def pieces(self) -> Iterator[bytes]:
        """Return the bytes of the answer as they come."""
        pieces: Iterator[bytes] = self.answer.iter_content(_PROGRESS_PIECE)
        return pieces

    def __exit__(self, *_error: object) -> None:
        """End the answer, but not the connections, which are the adapter's."""
        if self.answer.raw is not None:
            self.answer.close()


class Engine:
    """One robot's engine. Threads may use it at the same time; a long build does not hold up a question."""

    def __init__(self, link: EngineLink) -> None:
        """Take how the engine is reached."""
        self._link = link
        self._adapter = EngineAdapter(link.open, link.traffic)
        self._starting = threading.Lock()
        self._version = ""

    def warm(self, api_version: str = "") -> None:
        """Connect and agree on a version; for a thread of its own, so that the first request finds it done.

        An engine whose version is known from what it answered to somebody else is only connected to.
        """
        with contextlib.suppress(*_FAILURES):  # whoever asks first gets the reason
            self._agree(api_version)

    def close(self) -> None:
        """Close every connection to the engine."""
        self._adapter.close()

    def call(self, call: EngineCall, progress: Progress) -> Reply:
        """Send a request that changes something; a stream's lines go to `progress`.

        Raises:
            TransportError: The robot, not only its engine, is gone.
        """
        data = call.blob or call.body.encode("utf-8")
        headers = {"Content-Type": "application/x-tar" if call.blob else "application/json"} if data else {}
        try:
            with self.opened(call.timeout_s) as client:
                answer = client.send_call(call.method, call.path, params=dict(call.params), data=data, headers=headers)
                status = answer.status_code
                if call.stream and status in call.accept:
                    return follow(client.pieces(), status, progress)
                text = _text(answer)
        except Refused as refused:
            status, text = refused.status, refused.text
        except _FAILURES as error:
            return self._link.failure(error, call.timeout_s)
        ok = status in call.accept
        return Reply(status=status, out=text, err="" if ok else message_of(text), ok=ok)

    def load(self, chunks: Iterator[bytes], timeout_s: float, progress: Progress) -> Reply:
        """Load an image from the chunks of a `docker save`, as they come.

        Raises:
            TransportError: The robot is gone, or the chunks' source is.
        """
        try:
            with self.opened(timeout_s) as client:
                client.load_image(chunks, quiet=True)  # type: ignore[no-untyped-call]  # its stubs are incomplete
                return follow(client.pieces(), client.answer.status_code, progress)
        except Refused as refused:
            return Reply(status=refused.status, out=refused.text, err=refused.message, ok=False)
        except _FAILURES as error:
            return self._link.failure(error, timeout_s)

    def save(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream an image as `docker save` writes it, in pieces of about 1 MiB.

        Raises:
            TransportError: The engine does not have it, or went away.
        """
        no, broken = f"its engine cannot give {image}", f"its engine stopped giving {image}"
        with self.or_error(no, "is it still there?", broken, timeout_s), self.opened(timeout_s) as client:
            yield from client.get_image(within(image), _CHUNK)

    def log(self, container: str, *, tail: int, follow: bool, times: bool = False, since: str = "") -> Iterator[str]:
        """Yield a container's log line by line; with `follow` until the container ends. A negative tail is all of it.

        With `times`, each line begins with the engine's time and a space. `since` is a time by the engine's clock, in
        seconds since the epoch.

        An engine that sends more lines than it was asked for is not listened to.

        Raises:
            TransportError: There is no such container, or the engine or the robot went away.
        """
        params = {"stdout": 1, "stderr": 1, "tail": tail if tail >= 0 else "all", "follow": int(follow)}
        params |= {"timestamps": 1} if times else {}
        params |= {"since": since} if since else {}
        timeout = (_LOG_TIMEOUT_S, None if follow else WaitInAll(_LOG_TIMEOUT_S))
        no, hint = f"no log of {container}", "srprov status lists what is there"
        broken = f"the log of {container} ended"
        with self.or_error(no, hint, broken, _LOG_TIMEOUT_S), self.opened(_LOG_TIMEOUT_S) as client:
            answer = client.send_call("GET", f"/containers/{container}/logs", params=params, timeout=timeout)
            found = timed_lines(answer.raw) if times else lines(demultiplexed(answer.raw))
            yield from itertools.islice(found, None if follow or tail < 0 else tail)

    @contextlib.contextmanager
    def or_error(self, refusal: str, hint: str, loss: str, timeout_s: float) -> Iterator[None]:
        """Raise TransportError, with one of two beginnings, when the engine refuses or is lost."""
        try:
            yield
        except Refused as refused:
            said = f"{refusal}: {refused.message}"
            raise TransportError(self._link.host, said, hint=hint, code=Code.ENGINE) from None
        except _FAILURES as error:
            why = self._link.failure(error, timeout_s).err
            raise TransportError(self._link.host, f"{loss}: {why}", hint="try again", code=Code.LOST) from error

    def opened(self, timeout_s: float) -> _Client:
        """Return a client for one request; the time is for sending, and again for all of the answer."""
        return _Client(self._adapter, self._agree(), timeout_s)

    def _agree(self, api_version: str = "") -> str:
        """Agree on a version, once; the engine is asked for its own unless that is known."""
        with self._starting:
            if not self._version:
                # One connection before any other request may open a second: sshd's MaxSessions may allow no more.
                if api_version:
                    self._adapter.warm(_PING_TIMEOUT_S)
                self._version = negotiated(api_version or self._ask_version())
            return self._version

    def _ask_version(self) -> str:
        """Return the version that the engine names; nothing when it names none."""
        with _Client(self._adapter, MINIMUM_DOCKER_API_VERSION, _PING_TIMEOUT_S) as client:
            try:
                answer = client.get(f"{client.base_url}/_ping", timeout=_PING_TIMEOUT_S, stream=True)
            except Refused:
                return ""
            _text(answer)
            return answer.headers.get("Api-Version", "")


def negotiated(engine: str) -> str:
    """Return the API version that both sides speak.

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


def _text(response: requests.Response) -> str:
    """Read an answer to its end, but no more than would fit into any sensible one."""
    with response:
        data: bytes = response.raw.read(_LONGEST_ANSWER)
    return data.decode("utf-8", "replace")
