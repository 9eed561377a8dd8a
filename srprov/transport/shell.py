"""One long-lived `sh` on a robot: a batch of commands is one write and one wait.

Takes commands, gives replies; talks through `Streams`, which an SSH channel (`ssh.py`) and a local process
(`local.py`) provide. Both output streams are drained all the time, also while the batch is still being written:
paramiko's stderr and stdout share one window of 2 MiB, and reading one after the other deadlocks as soon as a command
fills it.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Sequence
from typing import Protocol

from srprov.errors import AuthError, ConnectError, DeadlineError, TransportError
from srprov.secret import Secret
from srprov.transport.deadline import Deadline
from srprov.transport.frames import Frames, batch, ready_line, sudo_prompt
from srprov.wire import Progress, Query, Reply, Run, Traffic

_SUDO_HINT = (
    "allow it without a password: echo '{user} ALL=(ALL) NOPASSWD: ALL' | sudo tee /etc/sudoers.d/srprov on the robot, "
    "log in as root (ansible_user: root), or give sudo's password (--ask-become-pass, ansible_become_password)"
)


class Streams(Protocol):
    """The three streams of a running shell, none of which blocks."""

    def write(self, data: memoryview) -> int:
        """Send what fits now; 0 when nothing does."""
        ...

    def read(self) -> tuple[bytes, bytes]:
        """Give what is here of standard output and of standard error."""
        ...

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until something can be read, or written when `writing`, or the seconds are over."""
        ...

    @property
    def ended(self) -> bool:
        """Tell whether nothing will come any more and all of it was read."""
        ...

    def reason(self) -> str:
        """Say why it ended."""
        ...

    def close(self) -> None:
        """End the shell; safe to call twice and from any thread."""
        ...


class Shell:
    """The robot's shell. One batch at a time: threads wait for each other."""

    def __init__(
        self, host: str, streams: Streams, traffic: Traffic, *, user: str = "", password: Secret | None = None
    ) -> None:
        """Take the robot's name, the streams of a shell that was just started, where to count, and sudo's password."""
        self._host = host
        self._streams = streams
        self._traffic = traffic
        self._user = user
        self._password = password
        self._lock = threading.Lock()
        self._closed = False

    def wait_ready(self, nonce: str, deadline: Deadline) -> None:
        """Throw away all that is printed before the shell says that it is ready; answer sudo when it asks.

        Raises:
            AuthError: sudo asks for a password, does not accept the one that there is, or is not allowed.
            ConnectError: The shell ended before it was ready.
            DeadlineError: It was not ready in time.
        """
        noise, complaints, mark = bytearray(), bytearray(), ready_line(nonce)
        answers = 0
        while mark not in noise:
            out, err = self._streams.read()
            noise += out
            complaints += err
            if self._password and complaints.count(sudo_prompt(nonce)) > answers:
                answers += 1
                self._answer(self._password, answers, deadline)
            if out or err:
                continue
            if self._streams.ended:
                raise self._not_ready(complaints.decode("utf-8", "replace"))
            if deadline.passed:
                self.close()
                raise DeadlineError(
                    self._host,
                    f"its shell was not ready within {deadline.seconds:g} s",
                    hint="a slow or waiting ~/.bashrc on the robot? try: ssh -v, then: sudo -n true",
                )
            self._streams.wait(deadline.left(), writing=False)

    def _answer(self, password: Secret, times: int, deadline: Deadline) -> None:
        """Tell sudo the password; when it asks again, it was wrong, and a third try might lock the account."""
        if times > 1:
            self.close()
            hint = "check ansible_become_password, or what was typed for --ask-become-pass"
            raise AuthError(self._host, f"sudo does not accept the password of user {self._user!r}", hint=hint)
        pending = memoryview(password.reveal().encode("utf-8", "surrogateescape") + b"\n")
        while pending and not self._streams.ended and not deadline.passed:
            pending = pending[self._streams.write(pending) :]
            if pending:
                self._streams.wait(deadline.left(), writing=True)

    def _not_ready(self, complaints: str) -> TransportError:
        """Give the error for a shell that never came up."""
        self.close()
        text = " ".join(complaints.split())[-300:]
        if "sudo" in text:
            return AuthError(
                self._host,
                f"user {self._user!r} cannot become root: {text}",
                hint=_SUDO_HINT.format(user=self._user),
            )
        why = text or self._streams.reason()
        return ConnectError(self._host, f"its shell ended at once: {why}", hint="is the user's login shell usable?")

    def ask(self, queries: Sequence[Query]) -> list[Reply]:
        """Run all of them in one round trip; replies in the same order.

        Raises:
            DeadlineError: One took longer than its `timeout_s`; the shell is closed.
            TransportError: The connection or the shell died.
        """
        return self._exchange([q.command for q in queries], [q.timeout_s for q in queries], None)

    def run(self, run: Run, progress: Progress, shown: str = "") -> Reply:
        """Run a script and give its output lines to `progress` as they come; errors show `shown` instead of it.

        Raises:
            TransportError: As `ask`.
        """
        return self._exchange([run.script], [run.timeout_s], progress, [shown or run.script])[0]

    def run_all(self, scripts: Sequence[str], limits_s: Sequence[float], shown: Sequence[str]) -> list[Reply]:
        """Run scripts in one round trip, each in a time of its own; errors show `shown` instead of them.

        Raises:
            TransportError: As `ask`.
        """
        return self._exchange(list(scripts), list(limits_s), None, list(shown))

    def close(self) -> None:
        """End the shell."""
        self._closed = True
        self._streams.close()

    def _exchange(
        self, commands: list[str], timeouts: list[float], progress: Progress | None, shown: list[str] | None = None
    ) -> list[Reply]:
        """Write one batch and wait for all of its answers."""
        if not commands:
            return []
        nonce = secrets.token_hex(16)
        text = batch(nonce, commands)
        with self._lock:
            if self._closed:
                raise TransportError(self._host, "its connection is closed", hint="connect again")
            self._traffic.round_trips += 1
            out, err = Frames(nonce, len(commands)), Frames(nonce, len(commands))
            try:
                self._pump(text, (out, err), shown or commands, timeouts, progress)
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
        commands: list[str],
        timeouts: list[float],
        progress: Progress | None,
    ) -> None:
        """Write and read at the same time until both streams have every answer; each command has its own time."""
        pending = memoryview(text)
        at, limit = 0, time.monotonic() + timeouts[0]
        while not (frames[0].done and frames[1].done):
            sent = self._streams.write(pending) if pending else 0
            pending = pending[sent:]
            received = self._take(frames, progress)
            here = min(len(frames[0].answers), len(frames[1].answers))
            if here > at and here < len(commands):
                at, limit = here, time.monotonic() + timeouts[here]
            if sent or received:
                continue
            if self._streams.ended:
                raise self._lost(commands[at])
            if (left := limit - time.monotonic()) <= 0:
                raise self._late(commands[at], timeouts[at])
            self._streams.wait(left, writing=bool(pending))

    def _take(self, frames: tuple[Frames, Frames], progress: Progress | None) -> bool:
        """Feed what is here to the frames, and its new lines to `progress`."""
        pieces = self._streams.read()
        try:
            for frame, piece in zip(frames, pieces, strict=True):
                if not piece or frame.done:
                    continue
                told = frame.told
                frame.feed(piece)
                if progress is not None:
                    for line in frame.rest(0, told) if frame.answers else frame.new_lines():
                        progress(line)
        except ValueError as error:
            raise TransportError(self._host, str(error), hint="connect again; report it when it comes back") from None
        return any(pieces)

    def _lost(self, command: str) -> TransportError:
        """Give the error for a connection that died while a command ran."""
        return TransportError(
            self._host,
            f"the connection was lost during `{excerpt(command)}`: {self._streams.reason()}",
            hint="is the robot up, and its network? what the command did is not known; plan again before applying",
        )

    def _late(self, command: str, seconds: float) -> DeadlineError:
        """Give the error for a command that took too long."""
        return DeadlineError(
            self._host,
            f"no answer within {seconds:g} s from `{excerpt(command)}`",
            hint="the robot may be overloaded or its network gone; it may still be running there",
        )


def excerpt(command: str, width: int = 60) -> str:
    """Give a command's first characters in one line."""
    line = " ".join(command.split())
    return line if len(line) <= width else line[: width - 1] + "…"
