"""Lines of several logs, by their times, whoever of their robots is slow, silent, wrong or gone."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any

import pytest

from srprov.codes import Code
from srprov.controller.merged_logs import LogLine, LogLost, MergedLogs, Source, Wanted, after
from srprov.errors import TransportError
from srprov.secret import Secret, forget
from srprov.wire import Reply

LIMIT_S = 10.0


def at(second: float, text: str) -> str:
    return f"2026-11-22T10:00:{second:012.9f}Z {text}"


class Played:
    """A session with one container."""

    def __init__(self, *logs: Iterable[str | float], states: Iterable[str] = ()) -> None:
        self.logs, self.states = iter(logs), iter(states)
        self.asked: list[dict[str, Any]] = []

    def container_log(self, _container: str, **more: Any) -> Iterator[str]:
        self.asked.append(more)
        for one in next(self.logs):
            if isinstance(one, float):
                time.sleep(one)
            elif one == "LOST":
                raise TransportError("r1", "the connection was lost", code=Code.LOST)
            else:
                yield str(one)

    def ask(self, _queries: Any) -> list[Reply]:
        return [Reply(status=200, out=f'{{"State": {{"Status": "{next(self.states, "exited")}"}}}}')]


def source(name: str, session: Any, ahead_s: float = 0.0) -> Source:
    return Source(label=name, service=name, host=name, container=name, session=session, ahead_s=ahead_s)


def told(*sources: Source, **wanted: Any) -> list[str]:
    """Return what came, in its order: text, or whose log was lost."""
    found: list[str] = []
    until = time.monotonic() + LIMIT_S
    with MergedLogs(sources, Wanted(**{"tail": 100, **wanted})) as merged:
        for some in merged.all():
            found += [one.text if isinstance(one, LogLine) else f"lost {one.source.label}" for one in some]
            assert time.monotonic() < until
    return found


@pytest.mark.parametrize("follow", [False, True])
def test_lines_come_in_the_order_of_their_times(follow: bool) -> None:
    one = Played([at(1, "a"), at(3, "c"), at(3.000002, "e")])
    other = Played([0.1, at(2, "b"), at(3.000001, "d"), at(9, "f")])
    slow = Played([0.3, at(0.5, "first")])
    assert told(source("x", one), source("y", other), source("z", slow), follow=follow) == ["first", *"abcdef"]


def test_a_clock_that_is_wrong_is_corrected_and_asked_in_its_own_time() -> None:
    right, fast = Played([at(1, "a"), at(3, "c")]), Played([at(32, "b"), at(34, "d")])
    assert told(source("x", right), source("y", fast, ahead_s=30.0), since=1000.25) == [*"abcd"]
    assert (right.asked[0]["since"], fast.asked[0]["since"]) == ("1000.250000", "1030.250000")


def test_a_log_stays_in_its_own_order_whatever_its_times_say() -> None:
    odd = Played([at(5, "1"), at(1, "2"), "no time at all", "2026-99-22T10:00:00Z 4", at(6, "5"), ""])
    assert told(source("x", odd), source("y", Played([at(5.5, "y")]))) == [
        "1",
        "2",
        "no time at all",
        "4",
        "y",
        "5",
        "",
    ]


def test_a_silent_log_holds_up_the_others_for_a_moment_only() -> None:
    over = threading.Event()

    class Silent(Played):
        def container_log(self, _container: str, **_more: Any) -> Iterator[str]:
            over.wait(LIMIT_S)
            return iter(())

    sources = [source("x", Played([at(1, "a"), 1.2, at(2, "b"), 1.2])), source("y", Silent())]
    came: dict[str, float] = {}
    began = time.monotonic()
    with MergedLogs(sources, Wanted(tail=1, follow=True)) as merged:
        for some in merged.all():
            came |= {one.text: time.monotonic() - began for one in some if isinstance(one, LogLine)}
            if len(came) == 2:
                break
    over.set()
    assert came["a"] < LIMIT_S / 2, "a second at the beginning"
    assert came["b"] - came["a"] < LIMIT_S / 2, "a third of one later"


def test_a_lost_log_is_told_and_the_others_go_on() -> None:
    lost, well = Played([at(1, "a"), "LOST"]), Played([0.3, at(2, "b"), 0.3, at(3, "c")])
    found = told(source("x", lost), source("y", well), follow=True)
    assert sorted(found) == ["a", "b", "c", "lost x"]
    assert [one for one in found if one in "bc"] == ["b", "c"]


def test_what_nobody_takes_is_not_read() -> None:
    made = itertools.count()

    def endless() -> Iterator[str]:
        for number in made:
            yield at(1, f"{number} {'x' * 1000}")

    with MergedLogs([source("x", Played(endless()))], Wanted(tail=-1)) as merged:
        until = time.monotonic() + LIMIT_S
        while next(made) < 100 and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(0.2)
        assert next(made) < 1000
        assert any(merged.all())


def test_a_container_that_is_started_again_is_followed_on() -> None:
    """From where its log ended, once; a restart by hand takes a moment."""
    one = Played([at(1, "a")], [], [at(2, "b")], states=["exited", "running", "restarting", "exited", "exited"])
    assert told(source("x", one), follow=True) == ["a", "b"]
    moment = "1795341601.000000001"
    assert [(asked["tail"], asked["since"]) for asked in one.asked] == [(100, ""), (-1, moment), (-1, moment)]


@pytest.mark.parametrize(
    ("stamp", "moment"),
    [
        ("2026-11-22T10:00:00Z", "1795341600.000000001"),
        ("2026-11-22T10:00:00.5+00:00", "1795341600.500000001"),
        ("2026-11-22T10:00:00.999999999Z", "1795341601.000000000"),
    ],
)
def test_the_moment_after_a_line_is_exact(stamp: str, moment: str) -> None:
    assert after(stamp) == moment


def test_a_log_without_end_is_cut_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srprov.controller.merged_logs.MOST_BYTES", 1 << 20)
    endless = Played(itertools.repeat(at(1, "x" * 1000)))
    found = told(source("x", endless), tail=-1)
    assert len(found) < 1200 and found[-1] == "lost x"


def test_a_log_of_empty_lines_has_an_end_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srprov.controller.merged_logs.MOST_BYTES", 1 << 16)
    found = told(source("x", Played(itertools.repeat(at(1, "")))), tail=-1)
    assert len(found) < 2000 and found[-1] == "lost x"


def test_lines_after_a_secret_of_several_lines_keep_their_times() -> None:
    Secret("open sesame\nnow")
    try:
        texts = ["xx", "say open sesame", "now you go", "yy", "zz"]
        log = Played([at(second, text) for second, text in enumerate(texts)])
        with MergedLogs([source("x", log)], Wanted(tail=-1)) as merged:
            found = [one for some in merged.all() for one in some if isinstance(one, LogLine)]
        assert [(one.time[17:19], one.text) for one in found] == [
            ("00", "xx"), ("01", "say ***"), ("02", "*** you go"), ("03", "yy"), ("04", "zz"),
        ]  # fmt: skip
    finally:
        forget()


def test_secrets_are_taken_out_before_lines_are_put_in_order() -> None:
    Secret("open sesame\nnow")
    try:
        log = Played([at(1, "say open sesame"), at(2, "now and go"), at(3, "end")])
        assert "sesame" not in " ".join(told(source("x", log))) and told(source("x", Played([at(1, "z")]))) == ["z"]
    finally:
        forget()


def test_what_is_lost_says_why() -> None:
    with MergedLogs([source("x", Played(["LOST"]))], Wanted(tail=1)) as merged:
        (lost,) = [one for some in merged.all() for one in some]
    assert isinstance(lost, LogLost) and lost.why == "the connection was lost"
