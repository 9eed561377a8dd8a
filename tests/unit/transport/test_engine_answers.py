from __future__ import annotations

import io
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.transport.engine.answers import demultiplexed, events, failure, follow, lines, message_of, quoted, told
from srprov.transport.engine.client import _Client, negotiated
from srprov.transport.engine.link import EngineGone

DEEP = "[" * 100_000


def frame(kind: int, text: bytes) -> bytes:
    return bytes([kind, 0, 0, 0]) + len(text).to_bytes(4, "big") + text


class Pieces(io.RawIOBase):
    """A stream that gives at most so many bytes at once."""

    def __init__(self, body: bytes, size: int) -> None:
        self.body, self.size = body, size

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        piece = self.body[: min(self.size, len(buffer))]
        self.body = self.body[len(piece) :]
        buffer[: len(piece)] = piece
        return len(piece)


def without_frames(body: bytes, size: int = 1000) -> bytes:
    return b"".join(demultiplexed(io.BufferedReader(Pieces(body, size))))


@given(st.lists(st.tuples(st.integers(1, 2), st.binary(min_size=1, max_size=30)), max_size=8), st.integers(1, 20))
def test_a_log_survives_any_cut(parts: list[tuple[int, bytes]], size: int) -> None:
    body = b"".join(frame(kind, text) for kind, text in parts)
    assert without_frames(body, size) == b"".join(text for _, text in parts)


@given(st.binary(max_size=60), st.integers(1, 20))
def test_any_bytes_of_a_robot_are_a_log(body: bytes, size: int) -> None:
    assert len(without_frames(body, size)) <= len(body)


def test_a_terminal_s_log_has_no_frames() -> None:
    assert without_frames(b"plain text\nof a terminal\n") == b"plain text\nof a terminal\n"
    assert without_frames(b"short") == b"short"
    assert without_frames(b"") == b""


@pytest.mark.parametrize("text", [b"", b"x"], ids=["empty", "nearly empty"])
def test_a_log_of_empty_frames_ends(text: bytes) -> None:
    """An engine sends none; so many that each piece has a byte of text at most are no log either."""

    class Endless(io.RawIOBase):
        def read1(self, size: int = -1) -> bytes:
            return frame(1, text) + frame(1, b"") * 8000

    with pytest.raises(EngineGone, match="more frames than text"):
        for _ in zip(demultiplexed(Endless()), range(1000), strict=False):
            pass


def test_a_log_of_the_shortest_frames_is_a_log() -> None:
    assert len(without_frames(frame(1, b"\n") * 400_000, 65_536)) == 400_000


def test_a_frame_that_claims_more_than_there_is_holds_no_memory() -> None:
    header = b"\1\0\0\0\xff\xff\xff\xff"
    pieces = list(demultiplexed(io.BufferedReader(Pieces(header + b"x" * 200_000, 1000))))
    assert sum(map(len, pieces)) == 200_000 and max(map(len, pieces)) <= 64 * 1024


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


def test_a_line_without_end_is_cut() -> None:
    cut = list(lines(b"x" * 100_000 for _ in range(25)))
    assert sum(map(len, cut)) == 2_500_000 and len(cut) == 3


def test_progress_that_makes_no_sense_is_skipped() -> None:
    said = f'{{"stream": "a"}}\n{DEEP}\n7\n[]\nnull\n{{"stream": {DEEP}\n{{"status": 7, "id": []}}\n{{"stream": "b"}}'
    seen: list[str] = []
    done = follow([said.encode()], 200, seen.append)
    assert (done.ok, done.out, seen) == (True, "a\nb", ["a", "b"])
    assert list(events([b"{", b'"x": "\xc3', b'\xa4"}\n'])) == [{"x": "ä"}], "a character in two pieces is one"
    assert message_of(DEEP) == DEEP[:500]


def test_an_error_of_any_shape_is_a_failure() -> None:
    for text in ('{"error": {"a": 1}}', '{"error": 7}', '{"errorDetail": {"code": 1}}', '{"errorDetail": "x"}'):
        done = follow([text.encode()], 200, lambda _line: None)
        assert (done.ok, done.err) == (False, "the engine did not say why"), text


@pytest.mark.parametrize("text", ["[1]", '{"auths": 5}', '{"auths": {"x": "y"}}', '{"proxies": 3}'])
def test_a_user_s_configuration_that_the_sdk_cannot_read_is_an_error_that_names_it(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "config.json").write_text(text)
    monkeypatch.setenv("DOCKER_CONFIG", str(tmp_path))
    with pytest.raises(EngineGone, match=r"config\.json of Docker on this machine"):
        _Client(cast(Any, None), "1.41", 1)
