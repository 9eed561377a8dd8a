"""Streams without secrets: whoever prints their lines learns nothing from what becomes of a guess, nor from when."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator

import pytest

from srprov.redaction import Known, Span, forms
from srprov.redaction_lines import as_they_come, lines_without, together
from srprov.secret import Secret, forget, redact_lines

VALUE = "walnut42-walnut"
GUESSES = [*(VALUE[:size] for size in range(1, len(VALUE))), VALUE.encode().hex()[:9], "d2Fsbn", "x", "~~"]
"""Beginnings of its forms, and words that begin none."""
LIMIT_S = 10.0


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    forget()
    yield
    forget()


class Counting(Known):
    """Counts the characters that are looked through."""

    looked = 0

    def masks(self, text: str) -> list[Span]:
        self.looked += len(text)
        return super().masks(text)


def known(value: str = VALUE) -> Counting:
    return Counting({value: forms(value)})


@pytest.mark.parametrize("size", [2, 38, 400])
def test_the_beginning_of_a_secret_is_a_line_like_any_other(size: int) -> None:
    """Blanks behind it may be a wrap. Each line of those was looked at with all before it, which took seconds."""
    blanks = [" " * size] * (40_000 // size)
    looked = set[int]()
    for guess in GUESSES:
        one, lines = known(), [guess[:1] * 20 + guess, *blanks, "end"]
        assert list(lines_without(one, together(lines))) == lines
        looked.add(one.looked - len(lines[0]))
    assert len(looked) == 1 and looked.pop() < 2 * 45_000


def test_a_guess_in_one_long_line_stays_in_it() -> None:
    """With a wrap as JSON writes it behind; who publishes a run's logs told everybody which guess was right."""
    Secret(VALUE)
    lines = [part for guess in GUESSES for part in (f"{guess}\\n{' ' * 17_000}", ".")]
    assert list(redact_lines(lines)) == lines
    assert list(redact_lines([f"{VALUE}\\n"])) == ["***\\n"]


@pytest.mark.parametrize("live", [False, True])
def test_a_secret_that_lines_break_is_hidden_in_each_of_them(live: bool) -> None:
    """Wherever one ends, and however far apart the batches are; no line is lost, and none is made."""
    Secret(VALUE)
    for before in (0, 1, 700, 16_370, 65_500):
        lines = ["." * before, "a walnut42", "  -wal", "", "nut b", "." * 70_000, VALUE, "end"]
        told = list(redact_lines(lines, live=live))
        assert told == ["." * before, "a ***", "***", "***", "*** b", "." * 70_000, "***", "end"]


def test_what_is_shown_does_not_cut_a_secret() -> None:
    """Batches end everywhere; a secret that reaches into what waits is not shown up to there."""
    lines = [f"{number} {'walnut42'}\n-walnut".split("\n") for number in range(300)]
    flat = list(itertools.chain.from_iterable(lines))
    for size in range(1, 8):
        batches = [flat[at : at + size] for at in range(0, len(flat), size)]
        assert list(lines_without(known(), batches)) == [f"{one} ***" if part == 0 else "***" for one in range(300)
                                                        for part in (0, 1)]  # fmt: skip


def test_one_secret_behind_the_other_is_no_reason_to_wait_for_ever() -> None:
    """Each line ends with half of one, so that all are one. None was shown, and all were looked at with each batch."""
    one, lines = known(), [VALUE[:8], *[f"{VALUE[8:]}{VALUE[:8]}"] * 60_000, VALUE[8:]]
    came = [0]

    def batches() -> Iterator[list[str]]:
        for batch in together(lines):
            came[0] += len(batch)
            yield batch

    told = 0
    for line in lines_without(one, batches()):
        told += 1
        assert set(line) == {"*"}
        assert came[0] - told < 20_000
    assert told == len(lines) and one.looked < 4 * 16 * len(lines)


def test_a_stream_that_breaks_has_shown_what_came() -> None:
    def broken() -> Iterator[str]:
        yield from ("a", "walnut42", "-walnut")
        raise OSError("gone")

    Secret(VALUE)
    for live in (False, True):
        told = list[str]()
        with pytest.raises(OSError, match="gone"):
            for line in redact_lines(broken(), live=live):
                told.append(line)
        assert told == ["a", "***", "***"]


def test_a_line_that_is_shown_as_it_comes_waits_a_moment_whatever_is_in_it() -> None:
    Secret(VALUE)
    go_on = threading.Event()

    def slow() -> Iterator[str]:
        for line in ("x", "walnut4", "end"):
            yield line
            go_on.wait(LIMIT_S)
            go_on.clear()

    stream = redact_lines(slow(), live=True)
    for line in ("x", "walnut4", "end"):
        begun = time.monotonic()
        assert next(stream) == line and time.monotonic() - begun < LIMIT_S / 2
        go_on.set()
    assert list(stream) == []


def test_nobody_goes_on_reading_for_who_has_left() -> None:
    read, ended = [0], threading.Event()

    def endless() -> Iterator[str]:
        try:
            while True:
                read[0] += 1
                yield "x" * 100
        finally:
            ended.set()

    batches = as_they_come(endless())
    assert next(batches)
    batches.close()  # type: ignore[attr-defined]  # it is a generator
    assert ended.wait(LIMIT_S) and read[0] < 5000
