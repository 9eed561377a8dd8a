"""`srprov exec` where its standard input or its connection is not what one would wish."""

from __future__ import annotations

import contextlib
import os
import pty
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from srprov.cli.attached import pass_input
from srprov.cli.raw_terminal import raw_terminal
from srprov.codes import Code
from srprov.errors import TransportError
from srprov.session import ContainerCommand


class Taking:
    """A command that takes input."""

    def __init__(self) -> None:
        self.got, self.closed = b"", False

    def write(self, data: bytes) -> None:
        self.got += data

    def close_input(self) -> None:
        self.closed = True


@pytest.mark.parametrize(("kind", "says"), [("folder", "Is a directory"), ("nonblocking", "temporarily unavailable")])
def test_input_that_cannot_be_read_ends_and_is_told(
    kind: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with contextlib.ExitStack() as stack:
        if kind == "folder":
            descriptor = os.open(tmp_path, os.O_RDONLY)
        else:
            descriptor, other = os.pipe()
            os.set_blocking(descriptor, False)
            stack.callback(os.close, other)
        stack.callback(os.close, descriptor)
        monkeypatch.setattr("sys.stdin", SimpleNamespace(fileno=lambda: descriptor))
        taking = Taking()
        pass_input(cast(ContainerCommand, taking))
    assert taking.closed and taking.got == b""
    assert says in capsys.readouterr().err


def test_a_connection_that_is_lost_while_the_size_is_told_leaves_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    uncaught: list[object] = []
    told = threading.Event()

    def lost(_rows: int, _columns: int) -> None:
        told.set()
        raise TransportError("r1", "the connection was lost", code=Code.LOST)

    monkeypatch.setattr("sys.stdin", SimpleNamespace(fileno=lambda: theirs))
    monkeypatch.setattr("threading.excepthook", uncaught.append)
    try:
        with raw_terminal(lost):
            assert told.wait(10)
            (teller,) = [one for one in threading.enumerate() if one.name == "window size"]
        teller.join(10)
        assert not teller.is_alive() and uncaught == []
    finally:
        os.close(ours)
        os.close(theirs)
