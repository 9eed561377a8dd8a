"""Markup, made in one place: elements of fixed names around text that is always escaped.

Takes names of elements and attributes that stand in this file, and any text; gives Html. Whatever a robot, a file or a
log says is text: no name of an element or attribute can come from data, and no address leads out of the page.

Source: WHATWG, "HTML Living Standard", section 13.1 (writing HTML documents).
"""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import TypeAlias

import msgspec

from srprov.errors import visible

_VOID = frozenset({"br", "link", "meta", "circle", "line", "path", "polyline", "rect"})
"""Elements without content; those of SVG end in `/>`."""
_SVG_VOID = frozenset({"circle", "line", "path", "polyline", "rect"})
_ELEMENTS = _VOID | frozenset(
    {"a", "article", "b", "bdi", "body", "caption", "code", "data", "dd", "details", "div", "dl", "dt", "footer",
     "g", "h1", "h2", "h3", "head", "header", "html", "li", "main", "nav", "ol", "p", "pre", "section", "span",
     "strong", "style", "summary", "svg", "table", "tbody", "td", "text", "th", "thead", "time", "title", "tr", "ul"}
)  # fmt: skip
_ATTRIBUTES = frozenset(
    {"aria-hidden", "aria-label", "aria-labelledby", "aria-describedby", "charset", "class", "colspan", "content", "cx",
     "cy", "d", "data-of", "datetime", "download", "fill", "fill-opacity", "height", "href", "http-equiv", "id", "lang",
     "name", "open", "points", "preserveAspectRatio", "r", "rel", "role", "scope", "stroke", "stroke-width", "tabindex",
     "text-anchor", "title", "transform", "value", "viewBox", "width", "x", "x1", "x2", "xmlns", "y", "y1", "y2"}
)  # fmt: skip
_SAFE_ADDRESS = ("#", "data:,", "data:application/json;base64,", "data:application/gzip;base64,")
LONGEST = 400
"""Characters of one text in a page, unless a caller wants more."""
_WHOLE = 100_000


class Html(msgspec.Struct, frozen=True):
    """Markup that is complete in itself; made only in this file."""

    markup: str


Child: TypeAlias = "Html | str | int | Iterable[Child] | None"
Value: TypeAlias = "str | int | float | bool | None"
NOTHING = Html("")


def cut(words: str, most: int = LONGEST) -> str:
    """Return a text of at most `most` characters; of a longer one, its beginning and how much is missing."""
    return words if len(words) <= most else f"{words[:most]}… ({len(words) - most} more characters)"


def both_ends(words: str, most: int) -> str:
    """Return a text of at most `most` characters; of a longer one, how much is missing between its ends."""
    half = most // 2
    return (
        words if len(words) <= most else f"{words[:half]}… ({len(words) - 2 * half} more characters) …{words[-half:]}"
    )


def text(words: str, most: int = LONGEST) -> Html:
    """Return any text as one line of the page: what would end a line or turn the writing around, by its number."""
    return Html(html.escape(visible(cut(words, most)), quote=True))


def whole(words: str) -> Html:
    """Return what a reviewer must know as one line: what is grave may stand behind a long name, or list."""
    return text(both_ends(words, _WHOLE), 2 * _WHOLE)


def lines(words: str, most: int = LONGEST) -> Html:
    """Return any text with its line breaks, for an element that keeps them."""
    return Html("\n".join(html.escape(visible(one), quote=True) for one in cut(words, most).split("\n")))


def join(parts: Iterable[Child]) -> Html:
    """Return parts one after the other."""
    return Html("".join(_inner(one) for one in parts))


def el(tag: str, *children: Child, **attributes: Value) -> Html:
    """Return an element.

    Args:
        tag: One of the elements that pages have.
        children: Markup, or text, which is escaped; None is nothing.
        attributes: `data_of` for `data-of`, `class_` for `class`; None and False leave one out, True is one without
            a value.

    Raises:
        ValueError: There is no such element or attribute here, or an address leads out of the page.
    """
    if tag not in _ELEMENTS:
        raise ValueError(f"no element {tag!r} is in a page")
    head = f"<{tag}{''.join(_attribute(name, value) for name, value in attributes.items())}"
    if tag in _VOID:
        return Html(head + ("/>" if tag in _SVG_VOID else ">"))
    return Html(f"{head}>{''.join([_inner(one) for one in children])}</{tag}>")


def style(rules: str) -> Html:
    """Return a style element; its rules are the program's own.

    Raises:
        ValueError: They could end the element.
    """
    if "<" in rules:
        raise ValueError("rules of style have no <")
    return Html(f"<style>{rules}</style>")


def document(root: Html) -> str:
    """Return a page as a file holds it."""
    return f"<!doctype html>\n{root.markup}\n"


def picture(root: Html) -> str:
    """Return an SVG element as a file of its own holds it."""
    return f"{root.markup}\n"


def _inner(child: Child) -> str:
    if child is None:
        return ""
    if isinstance(child, Html):
        return child.markup
    if isinstance(child, str):
        return text(child).markup
    if isinstance(child, int):
        return str(child)
    return "".join([_inner(one) for one in child])


def _attribute(name: str, value: Value) -> str:
    name = name if name in _ATTRIBUTES else name.rstrip("_").replace("_", "-")
    if name not in _ATTRIBUTES:
        raise ValueError(f"no attribute {name!r} is in a page")
    if value is None or value is False:
        return ""
    if value is True:
        return f" {name}"
    if name == "href":
        if not str(value).startswith(_SAFE_ADDRESS):
            raise ValueError("no address of a page leads out of it")
        return f' href="{html.escape(str(value), quote=True)}"'
    return f' {name}="{text(str(value), _LONGEST_LINE if name in _LINES else _LONGEST_VALUE).markup}"'


_LONGEST_VALUE = 800
"""Characters of an attribute."""
_LINES = frozenset({"d", "points"})
_LONGEST_LINE = 1_000_000
"""Characters of an attribute that holds the lines of a picture."""
