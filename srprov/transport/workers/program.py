"""The other process itself: how it is started, and how it ends.

`Program` is what `processes.py` needs of one; `LocalProgram` runs on this machine, those of sites are in `sites/`.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
from typing import Protocol

_KILLED_S = 6.0


class SiteError(Exception):
    """No process can be started at a site; `message` is for the robots there, `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        """Take both."""
        super().__init__(message)
        self.message, self.hint = message, hint


class Program(Protocol):
    """A process that serves robots at the other end of a socket."""

    name: str
    """What errors call it."""

    @property
    def socket(self) -> socket.socket:
        """This end of the socket."""

    def wait(self, seconds: float) -> str:
        """Wait for its end and say how it came; one that does not come in so many seconds is brought about."""

    def kill(self) -> None:
        """End it now; its connections and the socket end with it."""


def start_words(descriptor: int, *, home: bool) -> list[str]:
    """Return the command of a process that serves robots over an inherited socket.

    Args:
        descriptor: Of its end of the socket.
        home: The files of this machine are at the other end, not where it runs.
    """
    # no secret and no robot's name: everything else comes over the socket
    start = f"import sys; sys.path[:] = {sys.path!r}; from srprov.transport.workers.worker import main; "
    # -I: a module of the folder at hand, which may be a stranger's, is not imported before the text begins
    return [sys.executable, "-I", "-c", f"{start}main({descriptor}, home={home})"]


class LocalProgram:
    """One on this machine."""

    name = "the worker process of this robot"

    def __init__(self) -> None:
        """Start it."""
        self.socket, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                start_words(theirs.fileno(), home=False),
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for this process, which ends what has to end
            )  # fmt: skip

    def wait(self, seconds: float) -> str:
        """Wait for its end and say how it came; one that does not come in so many seconds is brought about."""
        try:
            code = self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):  # what the kernel does not let end, nobody waits for
                self.process.wait(_KILLED_S)
            return "hung up"
        return how_it_ended(code)

    def kill(self) -> None:
        """End it now."""
        self.process.kill()


def how_it_ended(code: int) -> str:
    """Return in words what a process ended with."""
    if code >= 0:
        return f"ended with {code}"
    known = {one.value: one.name for one in signal.Signals}
    return f"was ended by {known.get(-code, f'signal {-code}')}"
