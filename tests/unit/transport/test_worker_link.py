"""Calls over a socket pair, without a second process: both ends are here."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from srprov.codes import Code
from srprov.errors import AuthError, DeadlineError, TransportError
from srprov.session import Progress
from srprov.transport.workers import link as link_module
from srprov.transport.workers.flow import Flow
from srprov.transport.workers.link import ROOT, Link, LinkLost
from srprov.transport.workers.post import Post
from srprov.transport.workers.sealed import Handle
from srprov.transport.workers.served import act
from tests.unit.transport.waiting import wait_until


class _Odd(Exception):
    def __reduce__(self) -> str:
        raise TypeError("cannot leave")


class _Twisted(Exception):
    """It can leave, but nobody can make it again: its constructor takes something else."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} and {second}")


_ERRORS = {
    "auth": AuthError("r0", "no", hint="do"), "os": OSError(5, "io"), "key": KeyError(1), "odd": _Odd("so"),
    "twisted": _Twisted("so", "so"),
}  # fmt: skip


class _Root:
    def __init__(self) -> None:
        self.told = 0

    def fail(self, kind: str) -> None:
        raise _ERRORS[kind]

    def execute(self, lines: int, progress: Progress) -> int:
        for number in range(lines):
            progress(f"line {number}")
            self.told += 1
        return lines

    def echo(self, value: object) -> object:
        return value

    def save_image(self, count: int) -> Iterator[bytes]:
        yield from (b"%d" % number for number in range(count))
        if count == 3:
            raise DeadlineError("r0", "late")

    def copy_into(self, items: Iterator[Any]) -> list[Any]:
        return list(items)

    def sleep(self, seconds: float) -> str:
        time.sleep(seconds)
        return "slept"

    def hang(self) -> None:
        time.sleep(60)


def serve(link: Link) -> None:
    """Do what the process of an end does, in a thread."""

    def run() -> None:
        link.run()
        link.end("it went away")

    threading.Thread(target=run, daemon=True).start()


@pytest.fixture
def still() -> Iterator[tuple[Link, Link]]:
    """Give two ends, of which none reads yet."""
    links = [Link(Post(one), _Root(), act, print) for one in socket.socketpair()]
    yield links[0], links[1]
    for link in links:
        link.end("over")


@pytest.fixture
def pair(still: tuple[Link, Link]) -> tuple[Link, Link]:
    """Give two ends that serve each other."""
    for link in still:
        serve(link)
    return still


class Caller:
    """A call in a thread, and what came of it."""

    def __init__(self, call: Callable[[], object]) -> None:
        self.error: BaseException | None = None
        self._call = call
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._call()
        except BaseException as error:
            self.error = error

    def ended(self) -> BaseException | None:
        self._thread.join(30)
        assert not self._thread.is_alive(), "it waits for ever"
        return self.error


@pytest.mark.parametrize(("kind", "wanted"), [("auth", AuthError), ("os", OSError), ("key", KeyError)])
def test_what_is_raised_there_is_raised_here(pair: tuple[Link, Link], kind: str, wanted: type[Exception]) -> None:
    with pytest.raises(wanted) as caught:
        pair[0].call(ROOT, "fail", kind)
    if isinstance(caught.value, TransportError):
        assert (caught.value.host, caught.value.hint, caught.value.code) == ("r0", "do", Code.LOGIN)


@pytest.mark.parametrize(("kind", "wanted"), [("odd", "_Odd: so"), ("twisted", "_Twisted: so and so")])
def test_an_error_that_cannot_travel_is_told_in_words(pair: tuple[Link, Link], kind: str, wanted: str) -> None:
    import distributed  # by which any error can travel, with its traceback: not between our own processes

    assert distributed
    with pytest.raises(RuntimeError, match=wanted):
        pair[0].call(ROOT, "fail", kind, limit_s=20)
    assert pair[0].call(ROOT, "echo", 1) == 1, "and costs nobody else the link"


def test_calls_go_both_ways_at_once_and_streams_end_or_break_where_they_did(pair: tuple[Link, Link]) -> None:
    assert [link.call(ROOT, "echo", {"a": (1, b"2")}) for link in pair] == [{"a": (1, b"2")}] * 2
    given = pair[0].export(Flow(iter([b"x"] * 1000)))
    assert pair[0].call(ROOT, "copy_into", given) == [b"x"] * 1000
    handle = pair[0].call(ROOT, "save_image", 3)
    items = []
    with pytest.raises(DeadlineError):
        while some := pair[0].call(handle.number, "some"):
            items += some
    assert items == [b"0", b"1", b"2"]


def test_a_stream_that_nobody_wants_is_read_no_further_and_forgotten(pair: tuple[Link, Link]) -> None:
    before = len(pair[1].offered())
    handle = pair[0].call(ROOT, "save_image", 10_000_000)
    assert pair[0].call(handle.number, "some")
    pair[0].drop(Handle(handle.number))
    pair[0].call(ROOT, "echo", 1)
    wait_until(lambda: len(pair[1].offered()) == before, "it is forgotten")


# --- nobody waits without end -----------------------------------------------------------------------------------------


def test_who_waits_for_a_process_that_goes_away_is_told_so(pair: tuple[Link, Link]) -> None:
    caller = Caller(lambda: pair[0].call(ROOT, "hang"))
    wait_until(lambda: pair[1]._ahead, "it is called")
    pair[1].end("bye")
    assert isinstance(caller.ended(), LinkLost)
    with pytest.raises(LinkLost, match="it went away"):
        pair[0].call(ROOT, "echo", 1)


def test_who_waits_for_a_call_that_the_other_process_does_not_do_is_told_so(
    pair: tuple[Link, Link], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever became of it there: a thread that ended without an answer, for one."""
    monkeypatch.setattr(link_module, "LOOK_S", 0.1)
    pair[1]._serve = lambda number, *_words: pair[1]._ahead.pop(number)  # type: ignore[assignment]
    with pytest.raises(LinkLost, match="does not know what it was called for"):
        pair[0].call(ROOT, "echo", 1, limit_s=20)


def test_who_asks_after_a_call_that_is_being_done_goes_on_waiting(
    pair: tuple[Link, Link], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(link_module, "LOOK_S", 0.01)
    assert pair[0].call(ROOT, "sleep", 0.5) == "slept"


def test_a_limit_names_what_was_awaited(pair: tuple[Link, Link]) -> None:
    began = time.monotonic()
    with pytest.raises(LinkLost, match=r"no answer to `hang` within 0.2 s"):
        pair[0].call(ROOT, "hang", limit_s=0.2)
    assert time.monotonic() - began < 10, "it looks at the limit, not only now and then"
    assert pair[0].call(ROOT, "echo", 1) == 1


def test_who_leaves_a_call_does_not_hold_up_what_it_called(pair: tuple[Link, Link]) -> None:
    """Of the lines of a step, only so many are sent ahead of who takes them: here that is nobody any more."""

    def refuse(_line: str) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        pair[0].call(ROOT, "execute", 1000, progress=refuse)
    root = pair[1]._objects[ROOT]
    assert isinstance(root, _Root)
    wait_until(lambda: root.told == 1000, "the step ends")


def test_who_tells_lines_to_a_process_that_went_away_ends(pair: tuple[Link, Link]) -> None:
    taken = threading.Event()

    def take(_line: str) -> None:
        taken.wait(60)

    Caller(lambda: pair[0].call(ROOT, "execute", 1000, progress=take))
    root = pair[1]._objects[ROOT]
    assert isinstance(root, _Root)
    wait_until(lambda: root.told >= 64, "no more lines are under way")
    pair[1].end("bye")
    wait_until(lambda: not pair[1]._ahead, "the step ends", 5)
    taken.set()


def test_streams_for_a_process_that_went_away_are_closed(pair: tuple[Link, Link]) -> None:
    closed = threading.Event()

    def endless() -> Iterator[bytes]:
        try:
            yield from itertools.repeat(b"x" * 1000)
        finally:
            closed.set()

    pair[0].export(Flow(endless()))
    pair[1].end("bye")
    assert closed.wait(30)
    closed.clear()
    pair[0].export(Flow(endless()))
    assert closed.wait(30), "also of those that are begun later"


def test_a_stream_whose_end_fails_has_ended() -> None:
    class Bad(Iterator[bytes]):
        def __next__(self) -> bytes:
            raise StopIteration

        def close(self) -> None:
            raise OSError("it cannot be closed")

    assert isinstance(Caller(Flow(Bad()).some).ended(), OSError)


def test_an_interrupt_while_much_is_sent_leaves_no_half_message(still: tuple[Link, Link]) -> None:
    """Ctrl-C comes to the main thread, which is the one that calls here; nobody reads yet, so nothing more fits."""
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        still[0].call(ROOT, "echo", b"x" * 10_000_000)
    for link in still:
        serve(link)
    assert still[0].call(ROOT, "echo", 1, limit_s=30) == 1


def test_only_answers_to_pings_are_a_sign_of_life(still: tuple[Link, Link], monkeypatch: pytest.MonkeyPatch) -> None:
    """A process whose reader hangs may still write, and yet is of no use."""
    monkeypatch.setattr(link_module, "BEAT_S", 0.05)
    serve(still[0])
    silent = list[float]()
    for work in (still[0].beat, still[1].beat, lambda: still[0].watch(silent.append)):
        threading.Thread(target=work, daemon=True).start()
    wait_until(lambda: max(silent, default=0) > 0.2, "the silence is noticed")
    serve(still[1])
    wait_until(lambda: silent[-1] == 0, "it is over")
