"""What a site's worker runs for one srprov elsewhere: a process of its own, and the bytes to and from it.

A Dask actor. Each method takes or gives bytes that only the two processes understand. When the srprov that it is for
has asked for nothing for half a minute, or this worker ends, the process's socket is closed: it ends then, its
connections with it, and the robots end what ran there and free their locks.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import threading
import time

from srprov.transport.sites.settings import program_digest
from srprov.transport.workers.program import how_it_ended, start_words

ASK_S = 5.0
"""A question for bytes is answered after so many seconds, also by none."""
_ALONE_S = 30.0
"""Without a question for so long, whoever asked is gone."""
_LOOK_S = 2.0
_ENDING_S = 6.0
_MOST = 8 << 20
"""Bytes that are given, and kept ahead, at once."""


class WrongProgram(Exception):
    """The srprov at this site is another one."""


class Outpost:
    """One process of srprov at this site. It ends when Dask lets go of this object: its client ended, or was killed."""

    def __init__(self, digest: str) -> None:
        """Start it.

        Args:
            digest: Of the files of whoever asks.

        Raises:
            WrongProgram: This site has other files.
        """
        if digest != program_digest():
            raise WrongProgram("it has another version of srprov, or other files of it")
        self._process = _Process()
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._reading: asyncio.Task[bytes] | None = None

    async def send(self, data: bytes) -> None:
        """Pass bytes on to the process; those for one that has ended are dropped."""
        with contextlib.suppress(OSError):
            _, writer = await self._open()
            writer.write(data)
            await writer.drain()

    async def receive(self) -> bytes | None:
        """Return what the process says, as soon as it says something; nothing at its end, None when it is silent."""
        self._process.asked = time.monotonic()
        if self._reading is None:
            reader, _ = await self._open()
            self._reading = asyncio.ensure_future(_read(reader))
        done, _ = await asyncio.wait({self._reading}, timeout=ASK_S)
        self._process.asked = time.monotonic()
        if not done:
            return None
        found, self._reading = self._reading.result(), None
        return found

    async def end(self) -> str:
        """Close the socket, wait for the process, and say how it ended."""
        self._process.hang_up()
        return how_it_ended(await asyncio.to_thread(self._process.waited))

    def __del__(self) -> None:
        """Let the process end."""
        if process := getattr(self, "_process", None):
            process.hang_up()

    async def _open(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        if self._streams is None:
            self._streams = await asyncio.open_unix_connection(sock=self._process.socket, limit=_MOST)
        return self._streams


async def _read(reader: asyncio.StreamReader) -> bytes:
    try:
        return await reader.read(_MOST)
    except OSError:
        return b""


class _Process:
    """The process, and who watches over it."""

    def __init__(self) -> None:
        self.socket, theirs = socket.socketpair()
        self.asked = time.monotonic()
        """When somebody asked last for what it says."""
        with theirs:
            self._process = subprocess.Popen(
                start_words(theirs.fileno(), home=True),
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()], start_new_session=True,
            )  # fmt: skip
        threading.Thread(target=self._watch, name="outpost", daemon=True).start()

    def hang_up(self) -> None:
        """Close the socket: it ends then, as soon as its connections have."""
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)

    def waited(self) -> int:
        """Wait for its end, and see to it; return its exit code."""
        try:
            return self._process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()

    def _watch(self) -> None:
        """End it once nobody asks for what it says any more: a srprov that is cut off holds no robot."""
        while self._process.poll() is None:
            if time.monotonic() - self.asked > _ALONE_S:
                self.hang_up()
                self.waited()
            time.sleep(_LOOK_S)
