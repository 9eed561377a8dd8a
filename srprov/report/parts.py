"""Pieces that several sections of a page are made of. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec

from srprov.report.html import Child, Html, el, join

_STEPS = {"create": "+", "update": "~", "replace": "±", "delete": "-", "run": "!"}
OUTCOMES = {
    "changed": ("✓", "ok"),
    "unchanged": ("=", "soft"),
    "failed": ("✕", "bad"),
    "skipped": ("↷", "warn"),
    "unreachable": ("⌀", "bad"),
    "not reached": ("…", "warn"),
    "ok": ("✓", "ok"),
    "timeout": ("⏱", "warn"),
    "crashed": ("✕", "bad"),
    "infrastructure": ("⌀", "warn"),
    "interrupted": ("…", "warn"),
    "discarded": ("·", "soft"),
}
"""Outcome of a step, or status of a trial -> its mark and its class."""


class Section(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a page with a heading of its own."""

    id: str
    title: str
    body: Html


def table(
    caption: str, head: Sequence[str], rows: Iterable[Sequence[Child]], *, numbers: Iterable[int] = (), kind: str = "",
) -> Html:  # fmt: skip
    """Return a table that scrolls within itself where the page is too narrow.

    Args:
        caption: What it shows.
        head: Names of its columns; the first column names each row.
        rows: Cells, as many as there are names.
        numbers: Columns that hold numbers.
        kind: A class of the sheet.
    """
    right = frozenset(numbers)

    def cell(at: int, child: Child) -> Html:
        kind_of = "num" if at in right else None
        return el("td", child, class_=kind_of) if at else el("th", child, scope="row", class_=kind_of)

    names = [el("th", name, scope="col", class_="num" if at in right else None) for at, name in enumerate(head)]
    body = [el("tr", [cell(at, child) for at, child in enumerate(row)]) for row in rows]
    return scrolled(
        caption,
        el("table", captioned(caption), el("thead", el("tr", names)), el("tbody", body), class_=kind or None),
    )


def captioned(words: str) -> Html:
    """Return the caption of a table; it stays in sight and breaks its lines where the table is wider than the page."""
    return el("caption", el("span", words))


def scrolled(name: str, inside: Html) -> Html:
    """Return what may be wider than the page, so that the keyboard can reach all of it."""
    return el("div", inside, class_="scroll", tabindex="0", role="region", aria_label=name)


def fold(title: Child, *inside: Child, is_open: bool = False) -> Html:
    """Return what is folded away under a title."""
    return el("details", el("summary", title), *inside, open=is_open)


def outcome(word: str) -> Html:
    """Return an outcome as mark and word; one that is not known, as a word."""
    mark, kind = OUTCOMES.get(word, ("", "soft"))
    return el("span", f"{mark} {word}".strip(), class_=f"mark {kind}")


def action(word: str) -> Html:
    """Return what a step does, as symbol and word."""
    return el("span", f"{_STEPS.get(word, '?')} {word}", class_="mark")


def listed(items: Iterable[Child]) -> Html:
    """Return a list."""
    return el("ul", [el("li", one) for one in items])


def facts(pairs: Iterable[tuple[str, Child]]) -> Html:
    """Return names and what they stand for."""
    return el("dl", join([el("dt", name), el("dd", child)] for name, child in pairs), class_="facts")
