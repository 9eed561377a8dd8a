"""A number of trials as a picture: over the values of a parameter, and over the order in which they were run.

Takes rows of attempts; gives SVG as text. Names and values in it may be anybody's: they are text, never markup.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

import msgspec

from srprov.cli.output import clean
from srprov.codes import Code
from srprov.errors import UsageError, visible

_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM, _GAP = 420, 300, 70, 40, 60, 30
_BLUE, _ORANGE = "#2a5d84", "#d04a00"
_LONGEST = 24
_MOST_NAMED = 12
"""Values of a parameter that have their name below the axis."""
Row = Mapping[str, Any]


class _Axis(msgspec.Struct, frozen=True, kw_only=True):
    low: float
    high: float
    begin: float
    """Where the low end is drawn; the picture's y goes down."""
    end: float

    def at(self, value: float) -> float:
        share = (value - self.low) / (self.high - self.low)
        return round(self.begin + share * (self.end - self.begin), 2)


def draw(rows: Sequence[Row], number: str, parameter: str) -> str:
    """Return the picture of a column of numbers of those attempts that count; without a parameter, over the order only.

    Raises:
        UsageError: No attempt has the number, or none has the parameter.
    """
    some = [row for row in rows if _number(row.get(number)) is not None]
    if not some:
        known = sorted({name for row in rows for name, value in row.items() if _number(value) is not None})
        raise UsageError(
            f"no trial that counts has a number '{number}'",
            hint=f"there are: {', '.join(known) or 'none'}",
            code=Code.NO_SUCH_NAME,
        )
    if parameter and not all(isinstance(row.get(parameter), str) for row in some):
        known = sorted({name for row in some for name in row if name.startswith("p_")})
        raise UsageError(
            f"no parameter '{parameter}'", hint=f"there are: {', '.join(known) or 'none'}", code=Code.NO_SUCH_NAME
        )
    values = [float(row[number]) for row in some]
    scale = _scale(values, _TOP + _HEIGHT, _TOP)
    panels = [_over_parameter(some, values, scale, parameter)] if parameter else []
    panels.append(_over_order(some, values, scale))
    step = _WIDTH + _LEFT + _GAP
    body = "\n".join(f'<g transform="translate({at * step} 0)">\n{panel}\n</g>' for at, panel in enumerate(panels))
    width, height = step * len(panels), _TOP + _HEIGHT + _BOTTOM
    style = "text{font:12px sans-serif}line{stroke:#999}"
    title = _text((_LEFT + 10, 20), number, "start")
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">'
    return f"{head}\n<style>{style}</style>\n<rect width='100%' height='100%' fill='white'/>\n{title}\n{body}\n</svg>\n"


def _over_parameter(rows: Sequence[Row], values: Sequence[float], scale: _Axis, parameter: str) -> str:
    """Return a point for each attempt over its value of the parameter, and a line through the means."""
    words = sorted({str(row[parameter]) for row in rows})
    exact = all(_finite(word) is not None for word in words)
    if exact:
        words.sort(key=float)
    place = {word: float(word) if exact else float(at) for at, word in enumerate(words)}
    across = _scale(list(place.values()), _LEFT, _LEFT + _WIDTH, margin=0.1)
    points = [
        _point(across.at(place[str(row[parameter])]), scale.at(value)) for row, value in zip(rows, values, strict=True)
    ]
    means = []
    for word in words:
        mine = [value for row, value in zip(rows, values, strict=True) if row[parameter] == word]
        means.append(f"{across.at(place[word])},{scale.at(math.fsum(mine) / len(mine))}")
    line = f'<polyline points="{" ".join(means)}" fill="none" stroke="{_ORANGE}" stroke-width="1.5"/>'
    ticks = [(across.at(place[word]), word) for word in words[:_MOST_NAMED]]
    return "\n".join([*_frame(scale, ticks, parameter), *points, line])


def _over_order(rows: Sequence[Row], values: Sequence[float], scale: _Axis) -> str:
    """Return a point for each attempt, in the order in which they ended: a drift shows here."""
    across = _scale([1.0, float(len(rows))], _LEFT, _LEFT + _WIDTH, margin=0.05)
    points = [_point(across.at(at), scale.at(value)) for at, value in enumerate(values, start=1)]
    ends = dict.fromkeys((1, len(rows)))
    return "\n".join([*_frame(scale, [(across.at(at), str(at)) for at in ends], "order of ending"), *points])


def _frame(scale: _Axis, ticks: Sequence[tuple[float, str]], name: str) -> list[str]:
    """Return both axes, with their ticks and the name of the one below."""
    foot, right = _TOP + _HEIGHT, _LEFT + _WIDTH
    lines = [
        f'<line x1="{_LEFT}" y1="{foot}" x2="{right}" y2="{foot}"/>',
        f'<line x1="{_LEFT}" y1="{_TOP}" x2="{_LEFT}" y2="{foot}"/>',
    ]
    for share in range(5):
        value = scale.low + (scale.high - scale.low) * share / 4
        lines.append(_text((_LEFT - 6, scale.at(value) + 4), f"{value:.4g}", "end"))
    lines += [_text((place, foot + 18), word, "middle") for place, word in ticks]
    return [*lines, _text((_LEFT + _WIDTH / 2, foot + 42), name, "middle")]


def _scale(values: Sequence[float], begin: float, end: float, margin: float = 0.05) -> _Axis:
    """Return an axis that has all values, and some room at both ends."""
    low, high = min(values), max(values)
    room = (high - low) * margin or abs(high) * margin or 1.0
    return _Axis(low=low - room, high=high + room, begin=begin, end=end)


def _point(x: float, y: float) -> str:
    return f'<circle cx="{x}" cy="{y}" r="3" fill="{_BLUE}" fill-opacity="0.6"/>'


def _text(place: tuple[float, float], words: str, anchor: str) -> str:
    shown = escape(visible(clean(words))[:_LONGEST])
    return f'<text x="{place[0]:g}" y="{place[1]:g}" text-anchor="{anchor}">{shown}</text>'


def _number(value: object) -> float | None:
    return _finite(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _finite(value: Any) -> float | None:  # noqa: ANN401 - a text or a number
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if abs(found) < _LARGEST else None


_LARGEST = 1e100
"""Beyond it, the width of an axis may be none that a float can be."""
