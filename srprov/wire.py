"""What may travel to a robot, as data, and the two protocols that carry it.

A `Query` or `EngineQuery` reads; a `Run`, `Put`, `EngineCall` or `CopyImage` changes. They are plain values, to print,
compare, store and send later. `Reader` can only ask, `Session` can also execute: mypy refuses a change where only
reading is allowed. `transport/` implements both. Every shell word passes through `quote`.
"""

from __future__ import annotations

import base64
import hashlib
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from srprov.untrusted import json_or_none


def quote(word: str) -> str:
    """Return one POSIX shell word for any text.

    Raises:
        ValueError: The text holds a NUL byte, which no shell word can.
    """
    if "\0" in word:
        raise ValueError("a shell word cannot hold a NUL byte")
    return shlex.quote(word)


def sh(*words: str) -> str:
    """Return one shell command of quoted words: `sh("ip", "link", "show", name)`."""
    return " ".join(quote(word) for word in words)


@dataclass(frozen=True, kw_only=True, slots=True)
class Query:
    """A shell command that only reads; many are sent in one round trip."""

    command: str
    timeout_s: float = 20.0


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineQuery:
    """A GET to the robot's Docker Engine. `params` become the query string; dicts in it become JSON."""

    path: str
    params: tuple[tuple[str, str], ...] = ()
    timeout_s: float = 20.0
    headers: bool = False
    """The answer's headers are wanted, not its body: JSON, names in lower case."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """A shell script that changes the robot. Every word in it went through `quote`."""

    script: str
    timeout_s: float = 60.0

    def text(self) -> str:
        """Show it as the plan does."""
        return self.script


@dataclass(frozen=True, kw_only=True, slots=True)
class Put:
    """Write a file. `in_place` keeps the inode, so that a bind mount of the file sees the new content.

    With `secret`, the content is a placeholder: that secret's value, which only the transport's last step knows.
    """

    path: str
    content: bytes = b""
    mode: int = 0o644
    in_place: bool = False
    secret: str = ""
    timeout_s: float = 60.0

    def digest(self) -> str:
        """Return the content's sha256 in hex; of a secret there is none."""
        return "" if self.secret else hashlib.sha256(self.content).hexdigest()

    def text(self) -> str:
        """Show it as the plan does: never the content, which may be long."""
        how = "rewrite" if self.in_place else "write"
        if self.secret:
            return f"{how} {self.path} (<secret {self.secret}>, mode {self.mode:04o})"
        return f"{how} {self.path} ({len(self.content)} bytes, mode {self.mode:04o}, sha256 {self.digest()[:12]})"

    def script(self, source: str = "") -> str:
        """Return the shell script that does it: base64 inside a here-document, or from what `source` prints."""
        target, partial = quote(self.path), quote(self.path + ".part")
        move = f"cat {partial} > {target} && rm -f {partial}" if self.in_place else f"mv -f {partial} {target}"
        mode, folder = f"chmod {self.mode:04o}", quote(self.path.rsplit("/", 1)[0] or "/")
        last = f"{mode} {partial} && {move}" + (f" && {mode} {target}" if self.in_place else "")
        begin = f"umask 077; {{ [ -d {folder} ] || mkdir -p {folder}; }}"
        if source:
            return f"{begin} && {source} | base64 -d > {partial} && {last}"
        lines = base64.encodebytes(self.content).decode("ascii")
        return f"{begin} && base64 -d > {partial} <<'_END_OF_FILE_' && {last}\n{lines}_END_OF_FILE_\n"


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineCall:
    """A request that changes the robot's Docker Engine, addressed by name, sent through the docker SDK.

    `body` is canonical JSON text, or empty; `blob` is a raw body (a build context). `accept` lists the statuses that
    are fine. `stream` says that the answer is a progress stream of JSON lines in which an `error` line is a failure.
    """

    method: str
    path: str
    params: tuple[tuple[str, str], ...] = ()
    body: str = ""
    blob: bytes = b""
    accept: tuple[int, ...] = (200, 201, 204, 304)
    stream: bool = False
    timeout_s: float = 120.0

    def text(self) -> str:
        """Show it as the plan does."""
        query = "&".join(f"{key}={value}" for key, value in self.params)
        parts = [self.method, self.path + (f"?{query}" if query else "")]
        if self.body:
            parts.append(self.body)
        if self.blob:
            parts.append(f"<{len(self.blob)} bytes, sha256 {hashlib.sha256(self.blob).hexdigest()[:12]}>")
        return " ".join(parts)


@dataclass(frozen=True, kw_only=True, slots=True)
class CopyImage:
    """Bring an image from another robot's engine: saved there, loaded here, streamed through the controller."""

    image: str
    source_host: str
    timeout_s: float = 1800.0

    def text(self) -> str:
        """Show it as the plan does."""
        return f"copy image {self.image} from {self.source_host} (docker save | docker load over the controller)"


Command = Run | Put | EngineCall | CopyImage
AnyQuery = Query | EngineQuery


@dataclass(frozen=True, kw_only=True, slots=True)
class Reply:
    """What came back. `status` is an exit code for the shell and an HTTP status for the engine (0: no engine there)."""

    status: int
    out: str = ""
    err: str = ""
    ok: bool = True

    def json(self) -> Any:  # noqa: ANN401 - JSON is any; each parser checks the shape that it needs
        """Return the body as JSON; an empty, broken or hostile one is None."""
        return json_or_none(self.out)


@dataclass(slots=True)
class Traffic:
    """What a session used. What is asked of the shell and of the engine together is one round trip."""

    connections: int = 0
    round_trips: int = 0
    bytes_sent: int = 0
    bytes_received: int = 0
    connect_s: float = 0.0
    """From the dial to the ready shell."""
    asked_s: float = 0.0
    """Waited for answers; a sum over threads, as `acted_s` is."""
    acted_s: float = 0.0


Progress = Callable[[str], None]


def no_progress(_line: str) -> None:
    """Ignore progress."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Measures:
    """What a transport can measure without a shell (the controller itself, by psutil); sizes in bytes."""

    cpus: int
    load1: float
    memory_total: int
    memory_available: int
    swap_total: int
    swap_free: int
    link_speed_mbit: Mapping[str, float] = field(default_factory=dict)
    """interface -> Mbit/s, 0 where it is unknown"""


@dataclass(frozen=True, kw_only=True, slots=True)
class Pulse:
    """How the two ends of a `LockChannel` notice that they lost each other; the controller always gives up first."""

    beat_s: float = 5.0
    """How often the controller says that it is there."""
    controller_s: float = 20.0
    """Without an echo for so long the controller ends the session."""
    robot_s: int = 30
    """Without a word for so long the robot's end stops what the session runs there, and itself."""

    def __post_init__(self) -> None:
        """Refuse (ValueError) an order in which the robot's end could be gone while the controller still acts."""
        if not 0 < self.beat_s < self.controller_s < self.robot_s:
            raise ValueError("a heartbeat needs 0 < beat < controller < robot, in seconds")


class LockChannel(Protocol):
    """A script on the robot that lives as long as both ends hear each other; each letter it gets, it answers."""

    first_answer: str
    """The line that the script said by itself."""

    def send(self, letter: str, /) -> str:
        """Send one letter and return the line that answers it; TransportError when the contact is lost."""

    def close(self) -> None:
        """Send `e` and wait a moment for the script's end; safe to call twice, and never raises."""


class Reader(Protocol):
    """A way to ask one robot; it has no way to change it."""

    @property
    def host(self) -> str:
        """The robot's name in the inventory."""

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Ask shell and engine at the same time, each in one round trip; replies come in the order of the queries.

        A command that fails is a `Reply` with `ok` false; an engine that is not there gives `status` 0.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """

    def measure(self) -> Measures | None:
        """Return load and memory when that needs no shell, else None."""

    @property
    def traffic(self) -> Traffic:
        """What was used so far."""


class Session(Reader, Protocol):
    """A reader that can also change the robot."""

    def execute(self, command: Command, progress: Progress = no_progress) -> Reply:
        """Do one thing and wait for its end; a failure is a `Reply` with `ok` false and the reason in `err`.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """

    def execute_all(self, commands: Sequence[Run | Put]) -> Sequence[Reply]:
        """Do several short things in one round trip, one after the other, each whatever came of the others."""

    def open_lock_channel(self, script: str, words: Sequence[str], pulse: Pulse) -> LockChannel:
        """Run a script in a second shell, and keep it alive by a heartbeat; one round trip.

        The script says a line, then reads letters and answers each with one: `b`, the heartbeat, with `b`; `e` ends it.
        Its words: `$1`, SRPROV_SESSION in the environment of all processes of this session; `$2`, the seconds after
        which silence means that the controller is gone; `$3`, the connection's process, or nothing; then `words`.
        When the contact is lost, this session is closed and whatever it is asked for raises.

        Raises:
            TransportError: It cannot be started.
        """

    def save_image(self, image: str, timeout_s: float) -> Iterator[bytes]:
        """Stream the image as `docker save` writes it."""

    def container_log(self, container: str, *, tail: int, follow: bool) -> Iterator[str]:
        """Return a container's log line by line, standard output and error together; with `follow` until it ends.

        Raises:
            TransportError: The engine or the robot cannot be talked to any more.
        """

    def close(self) -> None:
        """End the connection; safe to call twice."""
