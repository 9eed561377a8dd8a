"""A number of trials as a picture: over the values of a parameter, and over the order in which they were run.

Takes rows of attempts; gives SVG, as a file of its own or as part of a page. Names and values in it may be anybody's:
they are text, never markup. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import msgspec

from srprov.codes import Code
from srprov.errors import UsageError
from srprov.report.html import Html, el, join, picture, style

_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM, _GAP = 420, 300, 70, 40, 60, 30
_LONGEST = 24
_MOST_NAMED = 12
"""Values of a parameter that have their name below the axis."""
_MOST_CIRCLES = 300
"""Points that are an element each; more of them are one line of dots, which takes a fifth of the room."""
_RULES = (
    "text{font:12px sans-serif}line{stroke:#999}circle{fill:#2a5d84;fill-opacity:.6}"
    "polyline{fill:none;stroke:#d04a00;stroke-width:1.5}.dots{stroke:#2a5d84;stroke-width:5;stroke-linecap:round}"
)
Row: TypeAlias = "Mapping[str, Any]"


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
    panels = _panels(rows, number, parameter)
    step = _WIDTH + _LEFT + _GAP
    body = join(el("g", panel, transform=f"translate({at * step} 0)") for at, panel in enumerate(panels))
    width, height = step * len(panels), _TOP + _HEIGHT + _BOTTOM
    title = _text((_LEFT + 10, 20), number, "start")
    back = el("rect", width="100%", height="100%", fill="white")
    return picture(
        el("svg", style(_RULES), back, title, body, xmlns="http://www.w3.org/2000/svg", width=width, height=height,
           viewBox=f"0 0 {width} {height}")
    )  # fmt: skip


def figures(rows: Sequence[Row], number: str, parameter: str) -> list[Html]:
    """Return the same as pictures in a page: over the parameter, if one is named, and over the order.

    Raises:
        UsageError: As `draw`.
    """
    size = f"0 {_TOP - 12} {_WIDTH + _LEFT + 12} {_HEIGHT + _BOTTOM}"
    ways = [f"over {parameter.removeprefix('p_')}"] if parameter else []
    return [
        el("svg", panel, viewBox=size, role="img", class_="plot", aria_label=f"{number.removeprefix('m_')} {way}")
        for panel, way in zip(_panels(rows, number, parameter), [*ways, "over the order of ending"], strict=True)
    ]


def _panels(rows: Sequence[Row], number: str, parameter: str) -> list[Html]:
    some = [row for row in rows if finite(row.get(number)) is not None]
    if not some:
        known = sorted({name for row in rows for name, value in row.items() if finite(value) is not None})
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
    return [*panels, _over_order(some, values, scale)]


def _over_parameter(rows: Sequence[Row], values: Sequence[float], scale: _Axis, parameter: str) -> Html:
    """Return a point for each attempt over its value of the parameter, and a line through the means."""
    words = in_order({str(row[parameter]) for row in rows})
    exact = all(_float(word) is not None for word in words)
    place = {word: float(word) if exact else float(at) for at, word in enumerate(words)}
    across = _scale(list(place.values()), _LEFT, _LEFT + _WIDTH, margin=0.1)
    spots = [(across.at(place[str(row[parameter])]), scale.at(value)) for row, value in zip(rows, values, strict=True)]
    means = []
    for word in words:
        mine = [value for row, value in zip(rows, values, strict=True) if row[parameter] == word]
        means.append(f"{across.at(place[word])},{scale.at(math.fsum(mine) / len(mine))}")
    ticks = [(across.at(place[word]), word) for word in words[:_MOST_NAMED]]
    return join(
        [_frame(scale, ticks, parameter.removeprefix("p_")), _points(spots), el("polyline", points=" ".join(means))]
    )


def in_order(words: set[str]) -> list[str]:
    """Return values of a parameter, as numbers if all of them are."""
    found = sorted(words)
    return sorted(found, key=float) if all(_float(word) is not None for word in found) else found


def _over_order(rows: Sequence[Row], values: Sequence[float], scale: _Axis) -> Html:
    """Return a point for each attempt, in the order in which they ended: a drift shows here."""
    across = _scale([1.0, float(len(rows))], _LEFT, _LEFT + _WIDTH, margin=0.05)
    spots = [(across.at(at), scale.at(value)) for at, value in enumerate(values, start=1)]
    ends = dict.fromkeys((1, len(rows)))
    return join([_frame(scale, [(across.at(at), str(at)) for at in ends], "order of ending"), _points(spots)])


def _frame(scale: _Axis, ticks: Sequence[tuple[float, str]], name: str) -> Html:
    """Return both axes, with their ticks and the name of the one below."""
    foot, right = _TOP + _HEIGHT, _LEFT + _WIDTH
    parts = [el("line", x1=_LEFT, y1=foot, x2=right, y2=foot), el("line", x1=_LEFT, y1=_TOP, x2=_LEFT, y2=foot)]
    parts += [_text((_LEFT - 6, scale.at(value) + 4), words, "end") for value, words in _marks(scale)]
    parts += [_text((place, foot + 18), word, "middle") for place, word in ticks]
    return join([*parts, _text((_LEFT + _WIDTH / 2, foot + 42), name, "middle")])


def _marks(scale: _Axis) -> list[tuple[float, str]]:
    """Return two to seven round numbers of an axis with their words; both ends where floats are too coarse for them."""
    rough = (scale.high - scale.low) / 6
    step = 10.0 ** math.floor(math.log10(rough))
    step *= next(factor for factor in (1, 2, 2.5, 5, 10) if step * factor >= rough * _NEARLY)
    first, last = math.ceil(scale.low / step), math.floor(scale.high / step)
    found = [(at * step, f"{at * step:.6g}") for at in range(first, last + 1)]
    if len({words for _, words in found}) < max(2, len(found)):
        found = [(value, f"{value:.6g}") for value in (scale.low, scale.high)]
    return found


def _scale(values: Sequence[float], begin: float, end: float, margin: float = 0.05) -> _Axis:
    """Return an axis that has all values, and some room at both ends."""
    low, high = min(values), max(values)
    room = (high - low) * margin or abs(high) * margin or 1.0
    return _Axis(low=low - room, high=high + room, begin=begin, end=end)


def _points(spots: Sequence[tuple[float, float]]) -> Html:
    if len(spots) <= _MOST_CIRCLES:
        return join(el("circle", cx=x, cy=y, r=3) for x, y in spots)
    return el("path", d="".join(f"M{x} {y}h0" for x, y in spots), class_="dots")


def _text(place: tuple[float, float], words: str, anchor: str) -> Html:
    return el("text", words[:_LONGEST], x=f"{place[0]:g}", y=f"{place[1]:g}", text_anchor=anchor)


def finite(value: object) -> float | None:
    """Return a number that can be drawn; None for anything else."""
    return _float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _float(value: Any) -> float | None:  # noqa: ANN401 - a text or a number
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if abs(found) < _LARGEST else None


_NEARLY = 1 - 1e-9
"""Against rounding: a step that is as large as it should be is large enough."""
_LARGEST = 1e100
"""Beyond it, the width of an axis may be none that a float can be."""
