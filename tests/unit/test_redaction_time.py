"""What a text costs tells nobody how a secret begins. Steps are counted: a time is another one on each machine."""

from __future__ import annotations

import gc
import itertools
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from srprov.redaction import Known, forms
from srprov.redaction_bytes import places

OWN, OTHER = "robot2-has-this-one", "zpkwmxvjtbqh"
"""What the robot that guesses knows, and what it wants to know."""
ANOTHER = str.maketrans("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ",
                        "1234567890bcdefahijklmnopqrstuvwxyzgBCDEFAHIJKLMNOPQRSTUVWXYZG")  # fmt: skip
"""Makes a wrong guess of a right one, with as many digits of hex in it."""


def steps(work: Callable[[], object]) -> int:
    """Return how many steps of Python something takes."""
    count = 0

    def trace(frame: FrameType, event: str, _value: Any) -> Any:
        nonlocal count
        frame.f_trace_opcodes = True
        count += event == "opcode"
        return trace

    before = sys.gettrace()
    gc.disable()  # what it ends has steps, too
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
        gc.enable()
    return count


def filled(word: str, size: int, known: str) -> str:
    return known + f"~{word}~" * (size // (len(word) + 2))


@pytest.mark.parametrize("known", ["", f"{OWN} "])
@pytest.mark.parametrize("size", [300, 5000])
def test_a_guess_at_how_a_secret_begins_takes_as_many_steps_as_any_other(size: int, known: str) -> None:
    """Also beside a secret that the robot knows itself, with which a text is looked at closer; in all forms."""
    secrets = Known({one: forms(one) for one in (OWN, OTHER)})
    for form, length in itertools.product(sorted(forms(OTHER)), (4, 6, 12, -1)):
        guess = form[:length]
        right, wrong = filled(guess, size, known), filled(guess.translate(ANOTHER), size, known)
        if set(guess) & {"%", "\\"} or any(whole in guess for whole in forms(OTHER)):
            continue
        assert secrets.without(right) == right.replace(OWN, "***"), form
        assert steps(lambda: secrets.without(right)) == steps(lambda: secrets.without(wrong)), guess  # noqa: B023


def test_only_a_whole_text_or_a_long_head_of_it_is_a_place() -> None:
    some = [b"walnut42-walnut", b"walnut", "gr\u00fc\u00dfe".encode(), b"x" * 500]
    found = places(some)
    assert sorted(found(b"walnu walnut42-walnu gr\xc3\xbc\xc3\x9f " + b"x" * 127)) == [6]
    assert sorted(found(b"-walnut42-walnut gr\xc3\xbc\xc3\x9fe" + b"x" * 129)) == [1, 10, 17, 24, 25]


def test_places_are_those_of_the_text_whatever_is_before_them() -> None:
    known = Known({"gr\u00fc\u00dfe \udcff aus": forms("gr\u00fc\u00dfe \udcff aus")})
    for before in ("", "\u00e9", "\udcc3\udca9", "\ud800 \U0001f600", "a\n\u00e9"):
        assert known.without(f"{before}gr\u00fc\u00dfe \udcff aus\u00e9") == f"{before}***\u00e9"
