"""A shell on this machine: a process and its three pipes."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess

from srprov.session import Traffic

_CHUNK = 1 << 16


class PipeStreams:
    """The pipes of a local process, for `Shell`."""

    def __init__(self, command: str, traffic: Traffic) -> None:
        """Start `sh -c command` in a process group of its own, so that Ctrl-C at the terminal does not reach it.

        Raises:
            OSError: There is no `sh`.
        """
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", command],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0, start_new_session=True,
        )  # fmt: skip
        self._traffic = traffic
        assert self._process.stdin and self._process.stdout and self._process.stderr
        self._pipes = (self._process.stdin, self._process.stdout, self._process.stderr)
        self._in, self._out, self._err = (pipe.fileno() for pipe in self._pipes)
        self._open = {self._out, self._err}
        self._closed = False
        for descriptor in (self._in, self._out, self._err):
            os.set_blocking(descriptor, False)

    def write(self, data: memoryview) -> int:
        """Send what the pipe takes."""
        try:
            sent = os.write(self._in, data[:_CHUNK])
        except OSError:
            return 0  # full, or closed: `ended` says so in a moment
        self._traffic.bytes_sent += sent
        return sent

    def read(self) -> tuple[bytes, bytes]:
        """Return what is here of both streams."""
        return self._read(self._out), self._read(self._err)

    def _read(self, descriptor: int) -> bytes:
        """Read one pipe until it is empty for now, or a fair share of it."""
        parts: list[bytes] = []
        while descriptor in self._open and len(parts) < 16:
            try:
                piece = os.read(descriptor, _CHUNK)
            except BlockingIOError:
                break
            except OSError:
                piece = b""
            if not piece:
                self._open.discard(descriptor)
                break
            parts.append(piece)
        data = b"".join(parts)
        self._traffic.bytes_received += len(data)
        return data

    def wait(self, seconds: float, *, writing: bool) -> None:
        """Sleep until a pipe can be used."""
        if self._closed:
            return
        poll = select.poll()
        for descriptor in self._open:
            poll.register(descriptor, select.POLLIN)
        if writing:
            poll.register(self._in, select.POLLOUT)
        with contextlib.suppress(OSError):
            poll.poll(1000 * seconds)

    @property
    def ended(self) -> bool:
        """Tell whether both pipes are at their end."""
        return self._closed or not self._open

    def reason(self) -> str:
        """Say how the shell ended."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return f"the shell ended with status {self._process.wait(timeout=0.2)}"
        return "the shell ended"

    def close(self) -> None:
        """End the shell and what it started."""
        if self._closed:
            return
        self._closed = True
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGTERM)
        with contextlib.suppress(OSError):
            self._pipes[0].close()
        try:
            self._process.wait(timeout=1)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for pipe in self._pipes[1:]:
            with contextlib.suppress(OSError):
                pipe.close()
