"""One long-lived `sh` on a robot: a batch of commands is one write and one wait.

Takes commands, returns replies; talks through `Streams`, which an SSH channel (`openssh/channel.py`) and a local
process (`pipes.py`) provide. Both output streams are drained all the time, also while the batch is still being written:
paramiko's stderr and stdout share one window of 2 MiB, and reading one after the other deadlocks as soon as a command
fills it.
"""

from __future__ import annotations

import math
import secrets
import threading
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import DeadlineError, TransportError
from srprov.session import Progress, Traffic
from srprov.transport.deadline import BATCH_S, Deadline, Patience
from srprov.transport.shell.frames import Frames, batch
from srprov.wire import Put, Query, Reply, Run

if TYPE_CHECKING:
    from srprov.session import Streams


class Shell:
    """The robot's shell. One batch at a time: threads wait for each other."""

    def __init__(self, host: str, streams: Streams, traffic: Traffic) -> None:
        """Take the robot's name, the streams of a shell that is ready before it is used, and where to count."""
        self.traffic = traffic
        self._host = host
        self._streams = streams
        self._lock = threading.Lock()
        self._closed = False

    def ask(self, queries: Sequence[Query]) -> list[Reply]:
        """Run all of them in one round trip; replies in the same order.

        Raises:
            DeadlineError: One took longer than its `timeout_s`; the shell is closed.
            TransportError: The connection or the shell died.
        """
        commands = [query.command for query in queries]
        in_place = {at for at, query in enumerate(queries) if query.in_place}
        limits = [query.timeout_s for query in queries]
        return self._exchange(commands, limits, commands, in_place=in_place, most_s=max(limits, default=0.0) + BATCH_S)

    def run(self, command: Run | Put, script: str, progress: Progress) -> Reply:
        """Run a command's script and pass its output lines to `progress` as they come; errors show its text instead.

        Raises:
            TransportError: As `ask`.
        """
        in_place = {0} if isinstance(command, Run) and command.in_place else ()
        return self._exchange([script], [command.timeout_s], [command.text()], progress, in_place)[0]

    def run_all(self, scripts: Sequence[str], limits_s: Sequence[float], shown: Sequence[str]) -> list[Reply]:
        """Run scripts in one round trip, each in a time of its own; errors show `shown` instead of them.

        Raises:
            TransportError: As `ask`.
        """
        return self._exchange(scripts, limits_s, shown)

    def close(self) -> None:
        """End the shell."""
        self._closed = True
        self._streams.close()

    def _exchange(
        self,
        commands: Sequence[str],
        limits_s: Sequence[float],
        shown: Sequence[str],
        progress: Progress | None = None,
        in_place: Collection[int] = (),
        most_s: float = math.inf,
    ) -> list[Reply]:
        """Write one batch and wait for all of its answers; `progress` gets the lines of a single command."""
        if not commands:
            return []
        nonce = secrets.token_hex(16)
        text = batch(nonce, commands, in_place)
        with self._lock:
            if self._closed:
                raise TransportError(self._host, "its connection is closed", hint="connect again", code=Code.LOST)
            self.traffic.round_trips += 1
            out, err = (Frames(nonce, len(commands), only_end=progress is not None) for _ in range(2))
            try:
                self._pump(text, (out, err), limits_s, shown, progress, most_s)
            except BaseException:
                # Half a batch may still be running: nothing that this shell says can be trusted any more.
                self.close()
                raise
        return [
            Reply(status=status, out=o.decode("utf-8", "replace"), err=e.decode("utf-8", "replace"), ok=status == 0)
            for (o, status), (e, _) in zip(out.answers, err.answers, strict=True)
        ]

    def _pump(
        self,
        text: bytes,
        frames: tuple[Frames, Frames],
        limits_s: Sequence[float],
        shown: Sequence[str],
        progress: Progress | None,
        most_s: float,
    ) -> None:
        """Write and read at the same time until both streams have every answer; each command has its own time."""
        pending = memoryview(text)
        at, patience, whole = 0, Patience(limits_s[0]), Patience(most_s)
        while not (frames[0].done and frames[1].done):
            sent = self._streams.write(pending) if pending else 0
            pending = pending[sent:]
            received = self._take(frames, progress)
            here = min(len(frames[0].answers), len(frames[1].answers))
            if at < here < len(shown):
                at, patience = here, Patience(limits_s[here])
            patience.moved(sent + received)
            whole.moved(sent + received)
            if min(patience.left(), whole.left()) <= 0 and not (frames[0].done and frames[1].done):
                raise self._late(shown[at], limits_s[at] if patience.left() <= 0 else most_s)
            if sent or received:
                continue
            if self._streams.ended:
                raise self._lost(shown[at])
            self._streams.wait(min(patience.left(), whole.left()), writing=bool(pending))

    def _take(self, frames: tuple[Frames, Frames], progress: Progress | None) -> int:
        """Feed what is here to the frames, and its new lines to `progress`; return how many bytes it was."""
        pieces = self._streams.read()
        try:
            for frame, piece in zip(frames, pieces, strict=True):
                if piece and not frame.done:
                    frame.feed(piece)
                    for line in frame.new_lines() if progress else ():
                        progress(line)  # type: ignore[misc]  # it is there, or there are no lines
        except ValueError as error:
            hint = "look at the robot: its shell, and what its programs print; --exclude leaves it out"
            raise TransportError(self._host, str(error), hint=hint, code=Code.ANSWER) from None
        return sum(map(len, pieces))

    def _lost(self, command: str) -> TransportError:
        """Return the error for a connection that died while a command ran."""
        return TransportError(
            self._host,
            f"the connection was lost during `{excerpt(command)}`: {self._streams.reason()}",
            hint="is the robot up, and its network? what the command did is not known; plan again before applying",
            code=Code.LOST,
        )

    def _late(self, command: str, seconds: float) -> DeadlineError:
        """Return the error for a command that took too long."""
        return DeadlineError(
            self._host,
            f"no answer within {seconds:g} s from `{excerpt(command)}`",
            hint="the robot may be overloaded or its network gone; it may still be running there",
        )


def excerpt(command: str, width: int = 60) -> str:
    """Return a command's first characters in one line."""
    line = " ".join(command.split())
    return line if len(line) <= width else line[: width - 1] + "…"


def tell(host: str, streams: Streams, line: str, seconds: float = 20.0) -> None:
    """Write a line to a fresh shell, which then reads no further than it.

    Raises:
        TransportError: The shell ended, or does not read.
    """
    text, until = memoryview(line.encode("utf-8", "surrogateescape")), Deadline(seconds)
    while text:
        text = text[streams.write(text) :]
        if text and (streams.ended or until.passed):
            raise TransportError(
                host, f"a second shell does not read: {streams.reason()}", hint="try again", code=Code.LOST
            )
        if text:
            streams.wait(0.1, writing=True)
