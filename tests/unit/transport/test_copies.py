"""Copies whose robots say what nobody thought of: the step fails in words, and the run goes on."""

from __future__ import annotations

from typing import Any, cast

import pytest

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.transport import copies
from srprov.transport.image_deliver import _Spool
from srprov.transport.image_progress import Meter
from srprov.transport.image_there import Room
from srprov.wire import CopyImage

COPY = CopyImage(image="a:1", source_host="r2")


def test_what_is_odd_fails_and_who_is_gone_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    def odd(*_words: object) -> Any:
        raise ValueError("invalid literal\nfor int()")

    def gone(*_words: object) -> Any:
        raise TransportError("r1", "the connection was lost", code=Code.LOST)

    nothing = cast(Any, None)
    monkeypatch.setattr(copies, "copy_image", odd)
    reply = copies.copy(COPY, nothing, None, nothing, print)
    assert (reply.ok, reply.err) == (False, "what came cannot be read: ValueError: invalid literalfor int()")
    monkeypatch.setattr(copies, "copy_image", gone)
    with pytest.raises(TransportError, match="was lost"):
        copies.copy(COPY, nothing, None, nothing, print)


class Robot:
    """A robot whose script says one line."""

    host, ended = "r1", False

    def __init__(self, line: bytes) -> None:
        self.line = line

    def open_shell(self, _script: str) -> Any:
        return self

    def read(self) -> tuple[bytes, bytes]:
        said, self.line = self.line, b""
        return said, b""

    def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize("word", ["²", "-1", "1.5", "", "٣x"])
def test_a_count_of_bytes_may_be_anything(word: str) -> None:
    robot, archive, said = cast(Any, Robot(f"have {word}\n".encode())), cast(Any, None), list[str]()
    archive = type("Archive", (), {"size": 100, "unpacked": 100})()
    spool = _Spool(robot, archive, "0" * 64, 1.0)
    assert spool.deliver(Room(), Meter("a", said.append), said.append) is None
    assert not spool.possible and any("no place to spool it" in line for line in said)
