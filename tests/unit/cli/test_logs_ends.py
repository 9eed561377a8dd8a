"""`srprov logs -f | head`: the end of whoever reads is the end of all streams, also of those that say nothing."""

from __future__ import annotations

import itertools
import os
import sys
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.cli.logs import _Lines
from srprov.cli.streams import lost, surviving
from srprov.errors import TransportError


def test_a_silent_container_does_not_hold_up_the_end(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    stream = surviving(writer, sys.__stdout__)
    monkeypatch.setattr("sys.stdout", stream)
    closed = threading.Event()

    def silent(*_words: Any, **_more: Any) -> Iterator[str]:
        closed.wait(10)
        raise TransportError("r2", "the connection was closed")
        yield

    endless: Any = SimpleNamespace(container_log=lambda *_words, **_more: itertools.repeat("again"))
    quiet: Any = SimpleNamespace(container_log=silent)
    shown = _Lines(5)
    shown.all([(quiet, "quiet", "c1"), (endless, "loud", "c2")], 100, True)
    assert isinstance(lost(stream), BrokenPipeError) and not closed.is_set()
    closed.set()
    assert shown.ended.get(timeout=10) == "quiet"
    assert shown.lost == [] and capsys.readouterr().err == ""
    os.close(writer)
