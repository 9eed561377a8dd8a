"""Lines of a log with the engine's times: one time a line, whatever the engine cut, and however bytes arrive."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srprov.transport.engine.link import EngineGone
from srprov.transport.engine.timed_log import timed_lines

T = "2026-11-22T18:07:50.386498686Z "


class Pieces:
    """A log that comes in pieces of some sizes."""

    def __init__(self, data: bytes, sizes: list[int]) -> None:
        self.data, self.sizes = data, sizes

    def read1(self, size: int, /) -> bytes:
        count = min(size, self.sizes.pop() if self.sizes else size)
        piece, self.data = self.data[:count], self.data[count:]
        return piece


def frame(kind: int, text: str) -> bytes:
    data = text.encode()
    return bytes([kind, 0, 0, 0]) + len(data).to_bytes(4, "big") + data


LOG = b"".join(
    [
        frame(1, f"{T}one\n"), frame(1, f"{T}{'x' * 20}"), frame(2, f"{T}error"), frame(1, f"{T}{'y' * 20}\n"),
        frame(1, ""), frame(2, f"{T}s, two\n"), frame(1, f"{T}2026-11-22T18:07:50Z said\n"), frame(1, f"{T}no end"),
        frame(1, f"{T}\n"), frame(1, "short"),
    ]
)  # fmt: skip
LINES = [
    f"{T}one", f"{T}{'x' * 20}{'y' * 20}", f"{T}errors, two", f"{T}2026-11-22T18:07:50Z said", f"{T}no end", "short",
]  # fmt: skip


@given(st.lists(st.integers(1, 60), max_size=60))
def test_a_line_has_one_time_however_it_was_cut(sizes: list[int]) -> None:
    assert list(timed_lines(Pieces(LOG, sizes))) == LINES


@given(st.integers(0, len(LOG)), st.lists(st.integers(1, 60), max_size=20))
def test_a_log_that_ends_anywhere_gives_what_came(end: int, sizes: list[int]) -> None:
    found = list(timed_lines(Pieces(LOG[:end], sizes)))
    assert end < 9 or not found or "".join(LINES).startswith(found[0][:5])
    assert len(found) <= len(LINES) + 2


def test_a_terminal_has_no_frames() -> None:
    assert list(timed_lines(Pieces(f"{T}a\r\n{T}b".encode(), [3]))) == [f"{T}a", f"{T}b"]


def test_a_line_without_end_is_cut() -> None:
    data = b"".join(frame(1, f"{T}{'x' * 16_384}") for _ in range(200))
    found = list(timed_lines(Pieces(data, [])))
    assert 2 <= len(found) <= 5 and sum(line.count("x") for line in found) == 200 * 16_384


def test_frames_with_nothing_in_them_have_an_end() -> None:
    with pytest.raises(EngineGone, match="more frames than text"):
        list(timed_lines(Pieces(frame(1, "") * 300_000, [])))
