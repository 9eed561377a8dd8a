"""`srprov logs -f | head`: the end of whoever reads is the end of all streams, also of those that say nothing."""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import click
import pytest

from srprov.cli.logs import _show, _tail, _Text
from srprov.cli.since import since
from srprov.cli.streams import lost, surviving
from srprov.codes import Code
from srprov.controller.merged_logs import MergedLogs, Source, Wanted
from srprov.errors import TransportError

CLOSED_S = 10.0


class Silent:
    """A session with a container that says nothing until the connection is closed."""

    def __init__(self) -> None:
        self.closed, self.ended = threading.Event(), threading.Event()

    def container_log(self, *_words: Any, **_more: Any) -> Iterator[str]:
        self.closed.wait(CLOSED_S)
        self.ended.set()
        raise TransportError("r2", "the connection was closed", code=Code.LOST)
        yield


def source(name: str, session: Any) -> Source:
    return Source(label=name, service=name, host="r1", container=name, session=session)


@contextlib.contextmanager
def piped() -> Iterator[Any]:
    """Make a pipe standard output for a block; give it, and a function that ends its reader."""
    reader, writer = os.pipe()
    stream = surviving(writer, sys.__stdout__)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout", stream)
        yield SimpleNamespace(stream=stream, leave=lambda: os.close(reader))
    os.close(writer)


def shown(*sources: Source) -> bool:
    with MergedLogs(sources, Wanted(tail=100, follow=True)) as merged:
        return _show(merged, _Text(list(sources), times=False, color=False).show)


def test_a_silent_container_does_not_hold_up_the_end(capsys: pytest.CaptureFixture[str]) -> None:
    silent = Silent()
    endless: Any = SimpleNamespace(container_log=lambda *_words, **_more: itertools.repeat("again"))
    with piped() as pipe:
        pipe.leave()
        assert shown(source("quiet", silent), source("loud", endless)) is False
        assert isinstance(lost(pipe.stream), BrokenPipeError) and not silent.ended.is_set()
    silent.closed.set()
    assert silent.ended.wait(CLOSED_S)
    assert capsys.readouterr().err == "", "what ends then is nobody's concern"


def test_a_reader_that_leaves_is_noticed_without_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    """`logs -f | grep -m1 x` must end, though the next line may come in an hour."""
    silent = Silent()
    with piped() as pipe:
        threading.Timer(0.3, pipe.leave).start()
        began = time.monotonic()
        assert shown(source("quiet", silent)) is False
        assert 0.2 < time.monotonic() - began < 30 and not silent.ended.is_set()
        assert isinstance(lost(pipe.stream), BrokenPipeError)
    silent.closed.set()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("90", 910), ("90s", 910), ("10m", 400), ("15m30s", 70), ("2d", 0), ("1970-01-01T00:01:40Z", 100),
        ("1970-01-01T01:00:10.5+01:00", 10.5), (None, None),
    ],
)  # fmt: skip
def test_since_is_how_long_ago_or_a_moment(
    monkeypatch: pytest.MonkeyPatch, text: str | None, moment: float | None
) -> None:
    monkeypatch.setattr("srprov.cli.since.time.time", lambda: 1000.0)
    assert since(*[None] * 2, text) == moment  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["", "m", "1x", "m1", "5m1h", "yesterday", "2026-13-01", "9" * 40, "\x1b[31m"])
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match="neither a time ago"):
        since(*[None] * 2, text)  # type: ignore[arg-type]


def test_a_tail_is_a_number_or_all() -> None:
    assert [_tail(*[None] * 2, text) for text in ("0", "25", "all", None)] == [0, 25, -1, None]  # type: ignore[arg-type]
    for text in ("-1", "x", "", "9" * 30, "²"):
        with pytest.raises(click.BadParameter, match="neither a number of lines nor all"):
            _tail(*[None] * 2, text)  # type: ignore[arg-type]
