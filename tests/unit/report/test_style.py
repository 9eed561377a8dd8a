"""Colours of pages: text can be read in both schemes, as WCAG 2.1 AA wants it."""

from __future__ import annotations

import re

import pytest

from srprov.report.style import RULES

LIGHT, DARK = re.findall(r":root\{([^}]*)\}", RULES)[:2]
PAIRS = [
    *((ink, paper) for ink in ("text", "soft", "accent", "ok", "warn", "bad") for paper in ("bg", "panel")),
    *((ink, paper) for ink in ("text", "soft") for paper in ("faint", "okbg", "warnbg", "badbg")),
    ("ok", "okbg"), ("warn", "warnbg"), ("bad", "badbg"),
    *(("htext", f"h{at}") for at in range(1, 6)),
]  # fmt: skip
STROKES = ("act", "wait", "path")
"""Lines of pictures, which WCAG wants at 3:1."""


def colours(rules: str) -> dict[str, str]:
    return dict(re.findall(r"--(\w+):(#[0-9a-f]{3,6})", rules))


def luminance(colour: str) -> float:
    """Return the relative luminance. Source: WCAG 2.1, "relative luminance"."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * one for one in colour[1:])
    parts = [int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    linear = [one / 12.92 if one <= 0.04045 else ((one + 0.055) / 1.055) ** 2.4 for one in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_worked_out_as_wcag_says() -> None:
    assert contrast("#000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#fff") == pytest.approx(4.478, abs=0.001)


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_all_text_can_be_read(scheme: str) -> None:
    known = colours(scheme)
    assert {name for pair in PAIRS for name in pair} | set(STROKES) <= known.keys()
    faint = {pair: round(contrast(*(known[one] for one in pair)), 2) for pair in PAIRS}
    assert {pair: found for pair, found in faint.items() if found < 4.5} == {}
    lines = {name: round(contrast(known[name], known["panel"]), 2) for name in STROKES}
    assert {name: found for name, found in lines.items() if found < 3} == {}
