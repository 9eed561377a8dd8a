"""The protocols that carry what `wire.py` describes; `transport/` implements them.

`Reader` can only ask, `Session` can also execute: mypy refuses a change where only reading is allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import msgspec

from srprov.container_files import ContainerFiles
from srprov.wire import AnyQuery, Command, Put, Reply, Run


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


class Measures(msgspec.Struct, frozen=True, kw_only=True):
    """What a transport can measure without a shell (the controller itself, by psutil); sizes in bytes."""

    cpus: int
    load1: float
    memory_total: int
    memory_available: int
    swap_total: int
    swap_free: int
    link_speed_mbit: Mapping[str, float] = msgspec.field(default_factory=dict)
    """interface -> Mbit/s, 0 where it is unknown"""


class Pulse(msgspec.Struct, frozen=True, kw_only=True):
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


class Exec(msgspec.Struct, frozen=True, kw_only=True):
    """A command for a running container, as its user typed it."""

    command: tuple[str, ...]
    environment: tuple[str, ...] = ()
    """`NAME=VALUE` each."""
    user: str = ""
    folder: str = ""
    stdin: bool = False
    terminal: bool = False

    def body(self) -> dict[str, Any]:
        """Return what an engine is told. Source: Docker Engine API 1.41, "Create an exec instance"."""
        return {
            "AttachStdin": self.stdin,
            "AttachStdout": True,
            "AttachStderr": True,
            "Tty": self.terminal,
            "Cmd": list(self.command),
            "Env": list(self.environment),
            "User": self.user,
            "WorkingDir": self.folder,
        }


class Streams(Protocol):
    """The three streams of a running shell, none of which blocks."""

    def write(self, data: memoryview) -> int:
        """Send what fits now; 0 when nothing does."""

    def read(self) -> tuple[bytes, bytes]:
        """Return what is here of standard output and of standard error."""

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until something can be read, or written when `writing`, or the seconds are over."""

    @property
    def ended(self) -> bool:
        """Tell whether nothing will come any more and all of it was read."""

    def reason(self) -> str:
        """Say why it ended."""

    def close(self) -> None:
        """End the shell; safe to call twice and from any thread."""


class ContainerCommand(Protocol):
    """A command that runs in a container; one thread may read, another may write."""

    def output(self) -> Iterator[tuple[int, bytes]]:
        """Yield what it writes as it comes, each with 1 or 2 for its stream, until it ends.

        Raises:
            TransportError: The engine or the robot is gone.
        """

    def write(self, data: bytes) -> None:
        """Send to its standard input; what cannot be sent is dropped, since it has ended then."""

    def close_input(self) -> None:
        """Let it see the end of its standard input."""

    def resize(self, rows: int, columns: int) -> None:
        """Tell its terminal the size."""

    def exit_code(self) -> int | None:
        """Return its code, 0 to 255, once its output has ended; None when it was never run.

        Raises:
            TransportError: The engine does not know it.
        """

    def close(self) -> None:
        """Let go of its streams; it may go on."""


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

    @property
    def identity(self) -> str:
        """Its name, and what it proved to be: another inventory may give the name to another robot."""

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        """Ask shell and engine at the same time, each in one round trip; replies come in the order of the queries.

        A command that fails is a `Reply` with `ok` false; an engine that is not there gives `status` 0.

        Raises TransportError when the robot cannot be talked to any more.
        """

    def measure(self) -> Measures | None:
        """Return load and memory when that needs no shell, else None."""

    @property
    def traffic(self) -> Traffic:
        """What was used so far."""


class Session(Reader, ContainerFiles, Protocol):
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

    def open_shell(self, script: str) -> Streams:
        """Run a script in a shell of its own, whose standard input and output are the caller's; it ends with the lock.

        Raises:
            TransportError: It cannot be started.
        """

    def run_in(self, container: str, what: Exec) -> ContainerCommand:
        """Start a command in a running container. It ends with nobody: neither with the lock nor with the session.

        Raises:
            TransportError: It cannot be started there, in the engine's words; or the robot cannot be talked to.
        """

    def container_log(
        self, container: str, *, tail: int, follow: bool, times: bool = False, since: str = ""
    ) -> Iterator[str]:
        """Return a container's log line by line, standard output and error together; with `follow` until it ends.

        A negative tail is all of it. With `times`, each line begins with the engine's time and a space, and output and
        errors have lines of their own. `since` is a time by the engine's clock, in seconds since the epoch.

        Raises:
            TransportError: The engine or the robot cannot be talked to any more.
        """

    def close(self) -> None:
        """End the connection; safe to call twice."""


@runtime_checkable
class Preparing(Protocol):
    """A session that can get ready, in the background, to change something."""

    def prepare(self) -> None:
        """Begin to; safe to call twice."""
