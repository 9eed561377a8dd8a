"""Calls between two processes over one socket, in both directions and as many at a time as there are threads.

`call` names an object of the other process and one of its methods; a thread of that process does it and the value or
the error comes back. Lines of progress come before the answer and are taken by the thread that called, so they keep
their order, and whoever is slow to take them slows down who sends.

Nobody waits without end. Every wait is for something that the other process does, and ends with the link (`LinkLost`):
that is over when the socket is, or when no answer to a ping comes (`watch`). Who waits for a call asks after it every
few seconds: a process that does not do it, and has not answered, says so. What has no reason to take long has a limit.

`post.py` has the socket.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from typing import Any

from srprov.session import Progress, no_progress
from srprov.transport.workers.post import Post
from srprov.transport.workers.sealed import Handle, packed, unpacked

ROOT = 0
"""The number of the object that each process offers from the beginning."""
BEAT_S = 5.0
LOOK_S = 10.0
"""How often who waits for a call looks whether it is still being done."""
_AHEAD = 64
"""Lines of progress that may be under way before the first of them was taken."""

Act = Callable[["Link", object, str, tuple[Any, ...], dict[str, Any], Progress], object]
"""Calls a method of an object for the other process; see `served.act`."""


class LinkLost(Exception):
    """The other process is gone, or does not answer; the text says how."""


class Link:
    """One end. `run` reads until the other end is closed; everything else is for any thread."""

    def __init__(self, post: Post, root: object, act: Act, log: Callable[[str], None]) -> None:
        """Take what carries messages, what the other process may call, how that is done, and who is told warnings."""
        self._post, self._act, self._log = post, act, log
        self._numbers = itertools.count(ROOT + 1)
        self._answers: dict[int, queue.SimpleQueue[tuple[str, Any]]] = {}
        self._ahead: dict[int, threading.Semaphore] = {}
        """The calls that are being done here, each with how many more lines it may tell."""
        self._objects: dict[int, object] = {ROOT: root}
        self._dropped: deque[int] = deque()
        self._why = ""
        self.over = threading.Event()
        """Set when the other process is gone."""
        self.heard = 0
        """Pings of here that were answered."""

    def call(  # words and what comes back are of any method
        self, target: int, method: str, *words: Any, progress: Progress = no_progress,  # noqa: ANN401
        limit_s: float = math.inf, **named: Any,  # noqa: ANN401
    ) -> Any:  # noqa: ANN401  # fmt: skip
        """Call a method of an object there, or read its attribute; what it raises is raised here.

        Raises:
            LinkLost: The other process is gone, or gave no answer within `limit_s`.
        """
        number, until = next(self._numbers), time.monotonic() + limit_s
        answers = self._answers[number] = queue.SimpleQueue()
        try:
            self._send("call", number, target, method, words, named)
            while (answer := self._answer(number, answers, until))[0] == "told":
                progress(answer[1])
                self._send("taken", number)
        except TimeoutError:
            raise LinkLost(f"no answer to `{method}` within {limit_s:g} s from its worker process") from None
        finally:
            del self._answers[number]
            self._leave(number, answers)
        if answer[0] == "done":
            return answer[1]
        raise answer[1]

    def _leave(self, number: int, answers: queue.SimpleQueue[tuple[str, Any]]) -> None:
        """Let a call go on whose lines nobody takes any more; `_take` does so with those that come later."""
        with contextlib.suppress(queue.Empty, LinkLost):
            while True:
                if answers.get_nowait()[0] == "told":
                    self._send("taken", number)

    def _answer(self, number: int, answers: queue.SimpleQueue[tuple[str, Any]], until: float) -> tuple[str, Any]:
        """Wait for the next word on a call, and ask after it now and then; TimeoutError when it is too late."""
        while True:
            with contextlib.suppress(queue.Empty):
                return answers.get(timeout=max(0.0, min(LOOK_S, until - time.monotonic())))
            if time.monotonic() >= until:
                raise TimeoutError
            self._send("sought", number)

    def tell_log(self, text: str) -> None:
        """Let the other process log a warning."""
        with contextlib.suppress(LinkLost):
            self._send("log", text)

    def export(self, found: object) -> Handle:
        """Keep an object here for the other process."""
        handle = Handle(next(self._numbers))
        self._objects[handle.number] = found
        if self.over.is_set():
            self.forget(handle)
        return handle

    def forget(self, handle: Handle) -> None:
        """Keep an object of here no longer."""
        found = self._objects.pop(handle.number, None)
        if (end := getattr(found, "dropped", None)) is not None:
            end()

    def drop(self, handle: Handle) -> None:
        """Let the other process forget an object, with the next message: this may be called while one is made."""
        self._dropped.append(handle.number)

    def offered(self) -> list[object]:
        """Return the objects that are kept for the other process."""
        return list(self._objects.values())

    def run(self) -> None:
        """Take messages until the other end is closed."""
        for data in self._post.received():
            message, dropped = unpacked(data)
            for number in dropped:
                self.forget(Handle(number))
            self._take(*message)

    def end(self, why: str) -> None:
        """Close this end, and wake who waits for the other one; the first reason counts."""
        if not self._why:
            self._why = why
        self.over.set()
        self._post.hang_up()
        for answers in list(self._answers.values()):
            answers.put(("lost", LinkLost(self._why)))
        for ahead in list(self._ahead.values()):
            ahead.release()  # who waits to tell a line learns that nobody listens
        for number in list(self._objects):
            if number != ROOT:
                self.forget(Handle(number))

    def beat(self) -> None:
        """Ask every few seconds whether the other process reads and writes, until the link is over."""
        while not self.over.wait(BEAT_S):
            with contextlib.suppress(LinkLost):
                self._send("ping")

    def watch(self, silent: Callable[[float], None]) -> None:
        """Tell after every few seconds for how many of them no ping was answered, until the link is over.

        What is counted are looks, not the clock: when the machine slept, so did the other process.
        """
        heard, looks = -1, 0
        while not self.over.wait(BEAT_S):
            looks = looks + 1 if self.heard == heard else 0
            heard = self.heard
            silent(looks * BEAT_S)

    def _take(self, kind: str, *rest: Any) -> None:  # noqa: ANN401 - as messages are
        """Pass on one message; never wait for anything."""
        with contextlib.suppress(LinkLost):
            if kind == "call":
                self._begin(*rest)
            elif kind in ("told", "done", "failed"):
                if (answers := self._answers.get(rest[0])) is not None:
                    answers.put((kind, rest[1]))
                elif kind == "told":
                    self._send("taken", rest[0])  # who called left: what it called goes on, and is not held up
            elif kind == "taken":
                if (ahead := self._ahead.get(rest[0])) is not None:
                    ahead.release()
            elif kind == "sought":
                if rest[0] not in self._ahead:  # an answer, if there was one, is on its way before this
                    self._send("failed", rest[0], LinkLost("its worker process does not know what it was called for"))
            elif kind == "ping":
                self._send("pong")
            elif kind == "pong":
                self.heard += 1
            elif kind == "log":
                threading.Thread(target=self._log, args=rest, name="log", daemon=True).start()

    def _begin(self, number: int, *what: Any) -> None:  # noqa: ANN401 - see `_serve`
        """Do what the other process called in a thread of its own."""
        self._ahead[number] = threading.Semaphore(_AHEAD)
        try:
            threading.Thread(target=self._serve, args=(number, *what), name="call", daemon=True).start()
        except RuntimeError as error:  # no more threads
            del self._ahead[number]
            self._post.put(self._failure(number, error))

    def _serve(self, number: int, target: int, method: str, words: tuple[Any, ...], named: dict[str, Any]) -> None:
        """Do it, and answer."""
        ahead = self._ahead[number]

        def progress(line: str) -> None:
            while not ahead.acquire(timeout=LOOK_S) and not self.over.is_set():
                pass  # it is slow, but there
            self._send("told", number, line)

        try:
            try:
                found = self._objects[target]
                data = self._packed("done", number, self._act(self, found, method, words, named, progress))
            except BaseException as error:  # raised where somebody waits
                data = self._failure(number, error)
            self._post.put(data)
        finally:
            del self._ahead[number]

    def _failure(self, number: int, error: BaseException) -> bytes:
        """Return an error as a message; of one that cannot be made again in the other process, what it says."""
        with contextlib.suppress(Exception):
            unpacked(packed(error))
            return self._packed("failed", number, error)
        text = "".join(traceback.format_exception(error))
        return self._packed("failed", number, RuntimeError(f"in a worker process:\n{text}"))

    def _send(self, *message: object) -> None:
        data = self._packed(*message)
        if self.over.is_set():
            raise LinkLost(self._why)
        self._post.put(data)

    def _packed(self, *message: object) -> bytes:
        dropped = []
        with contextlib.suppress(IndexError):
            while True:
                dropped.append(self._dropped.popleft())
        try:
            return packed((message, dropped))
        except BaseException:
            self._dropped.extend(dropped)
            raise
