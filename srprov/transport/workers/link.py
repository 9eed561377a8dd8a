"""Calls between two processes over one socket, in both directions and as many at a time as there are threads.

`call` names an object of the other process and one of its methods; a thread of that process does it and the value or
the error comes back. Lines of progress come before the answer and are taken by the thread that called, so they keep
their order, and whoever is slow to take them slows down who sends. When the other process ends, every call that waits
for it raises `LinkLost`.
"""

from __future__ import annotations

import contextlib
import itertools
import queue
import socket
import struct
import threading
import traceback
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from srprov.session import Progress, no_progress
from srprov.transport.workers.sealed import packed, unpacked

ROOT = 0
"""The number of the object that each process offers from the beginning."""
BEAT_S = 5.0
_AHEAD = 64
"""Lines of progress that may be under way before the first of them was taken."""
_HEAD = struct.Struct("!Q")

Act = Callable[["Link", object, str, tuple[Any, ...], dict[str, Any], Progress], object]
"""Calls a method of an object for the other process; see `served.act`."""


class LinkLost(Exception):
    """The other process is gone; the text says how."""


class Handle(msgspec.Struct, frozen=True):
    """An object that stays in its process, by its number there."""

    number: int


class Link:
    """One end. `run` reads until the other end is closed; everything else is for any thread."""

    def __init__(self, sock: socket.socket, root: object, act: Act, log: Callable[[str], None]) -> None:
        """Take the socket, what the other process may call, how that is done, and who is told its warnings."""
        self._socket, self._act, self._log = sock, act, log
        self._file = sock.makefile("rb")
        self._sending = threading.Lock()
        self._numbers = itertools.count(ROOT + 1)
        self._answers: dict[int, queue.SimpleQueue[tuple[str, Any]]] = {}
        self._ahead: dict[int, threading.Semaphore] = {}
        self._objects: dict[int, object] = {ROOT: root}
        self._dropped: deque[int] = deque()
        self._why = ""
        self.over = threading.Event()
        """Set when the other process is gone."""
        self.heard = 0
        """Messages that came so far."""

    def call(self, target: int, method: str, *words: Any, progress: Progress = no_progress, **named: Any) -> Any:  # noqa: ANN401 - of any method
        """Call a method of an object there, or read its attribute; what it raises is raised here.

        Raises:
            LinkLost: The other process is gone.
        """
        number = next(self._numbers)
        answers = self._answers[number] = queue.SimpleQueue()
        try:
            if self.over.is_set():
                raise LinkLost(self._why)
            self._send("call", number, target, method, words, named)
            while (answer := answers.get())[0] == "told":
                progress(answer[1])
                self._send("taken", number)
        finally:
            del self._answers[number]
        if answer[0] == "done":
            return answer[1]
        raise answer[1]

    def tell_log(self, text: str) -> None:
        """Let the other process log a warning."""
        with contextlib.suppress(LinkLost):
            self._send("log", text)

    def export(self, found: object) -> Handle:
        """Keep an object here for the other process."""
        number = next(self._numbers)
        self._objects[number] = found
        return Handle(number)

    def forget(self, handle: Handle) -> None:
        """Keep an object of here no longer."""
        found = self._objects.pop(handle.number, None)
        if (end := getattr(found, "dropped", None)) is not None:
            end()

    def drop(self, handle: Handle) -> None:
        """Let the other process forget an object, with the next message: this may be called while one is sent."""
        self._dropped.append(handle.number)

    def offered(self) -> list[object]:
        """Return the objects that are kept for the other process."""
        return list(self._objects.values())

    def run(self) -> None:
        """Take messages until the other end is closed."""
        with contextlib.suppress(OSError):
            while len(head := self._file.read(_HEAD.size)) == _HEAD.size:
                (size,) = _HEAD.unpack(head)
                if len(data := self._file.read(size)) < size:
                    return
                self.heard += 1
                message, dropped = unpacked(data)
                for number in dropped:
                    self.forget(Handle(number))
                self._take(*message)

    def end(self, why: str) -> None:
        """Close this end, and wake who waits for the other one; the first reason counts."""
        if not self._why:
            self._why = why
        self.over.set()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        for answers in list(self._answers.values()):
            answers.put(("lost", LinkLost(self._why)))

    def beat(self) -> None:
        """Say every few seconds that this process is there, until the link is over."""
        while not self.over.wait(BEAT_S):
            with contextlib.suppress(LinkLost):
                self._send("alive")

    def watch(self, silent: Callable[[float], None]) -> None:
        """Tell after every few seconds for how many of them nothing was heard, until the link is over.

        What is counted are looks, not the clock: when the machine slept, so did the other process.
        """
        heard, looks = -1, 0
        while not self.over.wait(BEAT_S):
            looks = looks + 1 if self.heard == heard else 0
            heard = self.heard
            silent(looks * BEAT_S)

    def _take(self, kind: str, *rest: Any) -> None:  # noqa: ANN401 - as messages are
        """Pass on one message; never wait for anything."""
        if kind == "call":
            threading.Thread(target=self._serve, args=rest, name="call", daemon=True).start()
        elif kind in ("told", "done", "failed"):
            if (answers := self._answers.get(rest[0])) is not None:
                answers.put((kind, rest[1]))
        elif kind == "taken":
            if (ahead := self._ahead.get(rest[0])) is not None:
                ahead.release()
        elif kind == "log":
            self._log(rest[0])

    def _serve(self, number: int, target: int, method: str, words: tuple[Any, ...], named: dict[str, Any]) -> None:
        """Do what the other process called, and answer."""
        ahead = self._ahead[number] = threading.Semaphore(_AHEAD)

        def progress(line: str) -> None:
            ahead.acquire()
            self._send("told", number, line)

        try:
            found = self._objects[target]
            data = self._packed("done", number, self._act(self, found, method, words, named, progress))
        except BaseException as error:  # raised where somebody waits
            data = self._failure(number, error)
        del self._ahead[number]
        with contextlib.suppress(LinkLost):
            self._write(data)

    def _failure(self, number: int, error: BaseException) -> bytes:
        """Return an error as a message; of one that cannot leave its process, what it says."""
        try:
            return self._packed("failed", number, error)
        except Exception:
            text = "".join(traceback.format_exception(error))
            return self._packed("failed", number, RuntimeError(f"in a worker process:\n{text}"))

    def _send(self, *message: object) -> None:
        self._write(self._packed(*message))

    def _packed(self, *message: object) -> bytes:
        dropped = []
        with contextlib.suppress(IndexError):
            while True:
                dropped.append(self._dropped.popleft())
        return packed((message, dropped))

    def _write(self, data: bytes) -> None:
        try:
            with self._sending:
                self._socket.sendall(_HEAD.pack(len(data)))
                self._socket.sendall(data)
        except OSError as error:
            raise LinkLost(self._why or f"the other process is gone: {error.strerror}") from None
