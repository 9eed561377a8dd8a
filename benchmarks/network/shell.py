"""A shell that stays open on a robot or in a container, so that a measurement does not pay for a `docker exec`."""

from __future__ import annotations

import contextlib
import os
import secrets
import select
import subprocess
import time
from collections.abc import Iterator, Sequence

from benchmarks.provisioning.robots import Trouble

_PIECE = 65536


class Shell:
    """A POSIX shell behind two pipes."""

    def __init__(self, argv: Sequence[str]) -> None:
        self._process = subprocess.Popen(
            list(argv), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        )

    def run(self, command: str, limit_s: float = 20) -> tuple[int, str]:
        """Run a command to its end; give its exit code and what it printed on both streams.

        Raises:
            Trouble: It took longer, or the shell ended.
        """
        assert self._process.stdin is not None
        mark = secrets.token_hex(8)
        self._process.stdin.write(f"{{ {command}\n}} </dev/null; printf '\\n%s %s\\n' {mark} $?\n".encode())
        self._process.stdin.flush()
        said, deadline = b"", time.monotonic() + limit_s
        for piece in self._pieces(deadline):
            said += piece
            before, found, after = said.rpartition(f"\n{mark} ".encode())
            if found and after.endswith(b"\n"):
                return int(after), before.decode(errors="replace")
        raise Trouble(f"no end within {limit_s:g} s: {command}: {said[-300:].decode(errors='replace')}")

    def _pieces(self, deadline: float) -> Iterator[bytes]:
        assert self._process.stdout is not None
        descriptor = self._process.stdout.fileno()
        while (left := deadline - time.monotonic()) > 0 and select.select([descriptor], [], [], left)[0]:
            piece = os.read(descriptor, _PIECE)
            if not piece:
                return
            yield piece

    def close(self) -> None:
        """End the shell; what it runs in the background goes on."""
        with contextlib.suppress(BrokenPipeError):
            self._process.communicate(timeout=5)


@contextlib.contextmanager
def opened(argv: Sequence[str]) -> Iterator[Shell]:
    """Have a shell for a while."""
    shell = Shell(argv)
    try:
        yield shell
    finally:
        shell.close()
