from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.transport.engine import negotiated
from srprov.transport.engine_http import root_cause
from srprov.transport.engine_stream import EngineGone
from srprov.transport.engine_text import (
    demultiplex,
    demultiplexed,
    failure,
    lines,
    message_of,
    quoted,
    told,
)


def frame(kind: int, text: bytes) -> bytes:
    return bytes([kind, 0, 0, 0]) + len(text).to_bytes(4, "big") + text


@given(st.lists(st.tuples(st.integers(1, 2), st.binary(min_size=1, max_size=30)), max_size=8), st.integers(1, 20))
def test_a_log_survives_any_cut(parts: list[tuple[int, bytes]], size: int) -> None:
    body = b"".join(frame(kind, text) for kind, text in parts)
    pieces = [body[at : at + size] for at in range(0, len(body), size)]
    assert b"".join(demultiplex(pieces)) == b"".join(text for _, text in parts)


def test_a_terminal_s_log_has_no_frames() -> None:
    assert demultiplexed(b"plain text\nof a terminal\n") == b"plain text\nof a terminal\n"
    assert demultiplexed(b"short") == b"short"
    assert demultiplexed(b"") == b""


def test_lines() -> None:
    assert list(lines([b"a\nb", b"c\r\n", b"\xff\nlast"])) == ["a", "bc", "�", "last"]


@pytest.mark.parametrize(
    ("engine", "expected"), [("1.41", "1.41"), ("1.24", "1.24"), ("1.45", "1.45"), ("1.99", "1.45"), ("2.0", "1.45")]
)
def test_the_lower_version_is_spoken(engine: str, expected: str) -> None:
    assert negotiated(engine) == expected


@pytest.mark.parametrize("engine", ["", "1.12", "x.y"])
def test_no_version_in_common(engine: str) -> None:
    with pytest.raises(EngineGone):
        negotiated(engine)


def test_paths_cannot_be_left() -> None:
    assert quoted("/images/127.0.0.1:5000/a/b@sha256:cd/json") == "/images/127.0.0.1:5000/a/b@sha256:cd/json"
    assert quoted("/containers/a b?x=1#y%2F/json") == "/containers/a%20b%3Fx%3D1%23y%252F/json"
    for path in ("/containers/../info", "/containers/.", "/a/./b"):
        with pytest.raises(EngineGone, match="climbs out"):
            quoted(path)


def test_what_streams_say() -> None:
    assert told({"stream": "Step 1/2 : FROM x\n ---> abc\n\n"}) == ["Step 1/2 : FROM x", " ---> abc"]
    assert told({"status": "Downloading", "id": "abc", "progress": "[=> ]"}) == ["abc: Downloading [=> ]"]
    assert told({"status": "Digest: x"}) == ["Digest: x"]
    assert told({"aux": {"ID": "x"}}) == []
    assert failure({"errorDetail": {"message": "exit 3"}, "error": "other"}) == "exit 3"
    assert failure({"error": " plain "}) == "plain"
    assert failure({"errorDetail": None, "stream": "x"}) == ""


def test_error_answers() -> None:
    assert message_of('{"message": "no such image"}') == "no such image"
    assert message_of("404  page\nnot found") == "404 page not found"
    assert message_of("[1]") == "[1]"


def test_the_bottom_of_an_error_is_found() -> None:
    gone = EngineGone("why")
    outer = OSError("Connection aborted.", gone)
    wrapped = RuntimeError(outer)
    assert root_cause(wrapped) is gone
    plain = RuntimeError("x")
    assert root_cause(plain) is plain
