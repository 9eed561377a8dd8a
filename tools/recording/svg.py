"""Screens of a terminal as one SVG file that moves by CSS alone.

All screens stand below each other in a strip that jumps up behind a window. Who wants no motion, and paper, get the
last one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape

from tools.recording.terminal import Frame, Row, Span

LETTER = (8.4, 18.0)
"""Width and height of a letter, in pixels, at a size of 14."""
MARGIN = 14
LAST_S = 6.0
"""How long the last screen stands before the first one comes again."""
COLORS = {
    "black": "#6e7681", "red": "#ff7b72", "green": "#7ee787", "brown": "#e3b341", "yellow": "#e3b341",
    "blue": "#79c0ff", "magenta": "#d2a8ff", "cyan": "#76e3ea", "white": "#f0f6fc", "default": "#e6edf3",
}  # fmt: skip
FONT = "ui-monospace,SFMono-Regular,Menlo,Consolas,monospace"
BACKGROUND = "#0d1117"


def drawn(frames: Sequence[Frame], columns: int, title: str, about: str) -> str:
    """Return the file.

    Args:
        frames: The second at which each screen appears, in order, and its rows.
        columns: Letters of a row.
        title: What it shows, for those who do not see it.
        about: More of that.
    """
    rows = len(frames[0][1])
    width, height = columns * LETTER[0] + 2 * MARGIN, rows * LETTER[1]
    names: dict[Row, str] = {}
    for _, screen in frames:
        for row in screen:
            if row:
                names.setdefault(row, f"r{len(names)}")
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height + 2 * MARGIN:g}" role="img"'
        ' aria-labelledby="t d">',
        f'<title id="t">{escape(title)}</title><desc id="d">{escape(about)}</desc>',
        f"<style>{_style(frames, height)}</style>",
        "<defs>",
        *(f'<text id="{name}">{"".join(_spans(row))}</text>' for row, name in names.items()),
        f'<clipPath id="w"><rect width="{width:g}" height="{height:g}"/></clipPath></defs>',
        f'<rect width="{width:g}" height="{height + 2 * MARGIN:g}" rx="8" fill="{BACKGROUND}"/>',
        f'<g transform="translate({MARGIN} {MARGIN})" clip-path="url(#w)"><g class="s">',
        *_strip(frames, names, height),
        "</g></g></svg>",
    ]
    return "\n".join(lines) + "\n"


def _style(frames: Sequence[Frame], height: float) -> str:
    begin = frames[0][0]
    whole = frames[-1][0] - begin + LAST_S
    steps = " ".join(
        f"{100 * (at - begin) / whole:.3f}%{{transform:translateY({-number * height:g}px)}}"
        for number, (at, _) in enumerate(frames)
    )
    last = f"translateY({-(len(frames) - 1) * height:g}px)"
    return (
        f"text{{font:14px {FONT};white-space:pre;fill:{COLORS['default']}}}"
        f".b{{font-weight:700}}.s{{transform:{last};animation:s {whole:.2f}s step-end infinite}}"
        f"@keyframes s{{{steps} 100%{{transform:{last}}}}}"
        "@media (prefers-reduced-motion:reduce){.s{animation:none}}@media print{.s{animation:none}}"
    )


def _spans(row: Row) -> Iterator[str]:
    """Yield a row's texts, each at its own column: fonts differ in how wide a letter is."""
    column = 0
    for span in row:
        start = len(span.text) - len(span.text.lstrip())
        if text := span.text.strip():
            yield f'<tspan x="{(column + start) * LETTER[0]:g}"{_look(span, text)}>{escape(_plain(text))}</tspan>'
        column += len(span.text)


def _look(span: Span, text: str) -> str:
    exact = f"#{span.color}" if re.fullmatch("[0-9a-f]{6}", span.color) else COLORS["default"]
    fill = "" if span.color == "default" else f' fill="{COLORS.get(span.color, exact)}"'
    bold = ' class="b"' if span.bold else ""
    return f' textLength="{len(text) * LETTER[0]:g}"{fill}{bold}'


def _plain(text: str) -> str:
    """Return a text without what XML cannot hold."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _strip(frames: Sequence[Frame], names: dict[Row, str], height: float) -> Iterator[str]:
    for number, (_, screen) in enumerate(frames):
        for line, row in enumerate(screen):
            if row:
                yield f'<use href="#{names[row]}" y="{number * height + (line + 0.75) * LETTER[1]:g}"/>'
