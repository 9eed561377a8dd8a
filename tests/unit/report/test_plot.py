"""Axes of the plots of trials."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from srprov.report.plot import draw


def marks(picture: str) -> list[tuple[float, str]]:
    """Return height and words of what stands left of the axis."""
    texts = [one for one in ElementTree.fromstring(picture).iter() if one.tag.endswith("}text")]
    return [(float(one.attrib["y"]), one.text or "") for one in texts if one.attrib["text-anchor"] == "end"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([108, 297, 435], ["100", "200", "300", "400"]),
        ([8, 18], ["8", "10", "12", "14", "16", "18"]),
        ([-0.3, 0.31], ["-0.2", "0", "0.2"]),
        ([5, 5], ["4.8", "4.9", "5", "5.1", "5.2"]),
        ([1_000_200, 1_000_400], ["1.0002e+06", "1.00025e+06", "1.0003e+06", "1.00035e+06", "1.0004e+06"]),
        ([1e99, -1e99], ["-1e+99", "-5e+98", "0", "5e+98", "1e+99"]),
        ([0.0, 5e-324], ["-1", "-0.5", "0", "0.5", "1"]),
    ],
)
def test_an_axis_has_round_numbers(values: list[float], words: list[str]) -> None:
    assert [said for _, said in marks(draw([{"m_x": value} for value in values], "m_x", ""))] == words


@pytest.mark.parametrize("values", [[1.0, 1.0 + 2**-52], [123456789.0, 123456789.5]])
def test_numbers_that_words_cannot_tell_apart_have_both_ends(values: list[float]) -> None:
    assert len(marks(draw([{"m_x": value} for value in values], "m_x", ""))) == 2


def test_a_mark_stands_where_a_point_of_its_value_does() -> None:
    picture = draw([{"m_x": value} for value in (100, 200, 300)], "m_x", "")
    circles = [float(y) for y in re.findall(r'<circle [^>]*cy="([0-9.]+)"', picture)]
    heights = {said: y - 4 for y, said in marks(picture)}
    assert [heights["100"], heights["200"], heights["300"]] == pytest.approx(circles)
