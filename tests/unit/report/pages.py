"""A page taken apart again, as strictly as a validator: for tests."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from typing import Any

from srprov.errors import visible

VOID = frozenset({"br", "link", "meta"})
BLOCKS = frozenset(
    {"article", "details", "div", "dl", "footer", "h1", "h2", "h3", "header", "main", "nav", "ol", "p", "pre",
     "section", "table", "ul"}
)  # fmt: skip
INSIDE = {
    "ul": {"li"}, "ol": {"li"}, "tr": {"td", "th"}, "thead": {"tr"}, "tbody": {"tr"}, "dl": {"dt", "dd", "div"},
    "table": {"caption", "thead", "tbody"}, "html": {"head", "body"},
    "head": {"meta", "title", "style", "link"},
}  # fmt: skip
"""Element -> what alone may stand directly in it, beside nothing: no text either."""
PHRASES = frozenset(
    {"p", "h1", "h2", "h3", "span", "b", "code", "bdi", "data", "time", "a", "summary", "caption", "pre"}
)
"""Elements in which no block may stand."""


class Page(HTMLParser):
    """Elements, texts and numbers of a page; `faults` says what is not as HTML wants it."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.stack: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.faults: list[str] = []
        self.ids: list[str] = []
        self.texts: list[str] = []
        self.numbers: list[tuple[str, str, str]] = []
        """JSON pointer, exact value and what people read, of each number that has a pointer."""
        self._number: tuple[str, str] | None = None
        if not text.startswith("<!doctype html>\n<html lang="):
            self.faults.append("no doctype")
        self.feed(text)
        self.close()
        if self.stack:
            self.faults.append(f"not closed: {self.stack}")
        self.faults += [f"twice: #{one}" for one in {one for one in self.ids if self.ids.count(one) > 1}]
        links = [about.get("href", "") for tag, about in self.elements if tag == "a"]
        self.faults += [f"{one} leads nowhere" for one in links if one.startswith("#") and one[1:] not in self.ids]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._opened(tag, attrs)
        if tag not in VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._opened(tag, attrs)
        if "svg" not in self.stack:
            self.faults.append(f"<{tag}/> outside of a picture")

    def _opened(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        about = {name: value or "" for name, value in attrs}
        if len(about) != len(attrs):
            self.faults.append(f"<{tag}> has an attribute twice")
        above = self.stack[-1] if self.stack else ""
        if above in INSIDE and tag not in INSIDE[above]:
            self.faults.append(f"<{tag}> in <{above}>")
        if tag in BLOCKS and PHRASES & set(self.stack):
            self.faults.append(f"<{tag}> within {self.stack}")
        if tag == "svg" and about.get("role") != "img" and "aria-hidden" not in about:
            self.faults.append("a picture without words")
        self.elements.append((tag, about))
        if "id" in about:
            self.ids.append(about["id"])
        if tag == "data" and "data-of" in about:
            self._number = (about["data-of"], about["value"])

    def handle_endtag(self, tag: str) -> None:
        if not self.stack or self.stack.pop() != tag:
            self.faults.append(f"</{tag}> closes nothing")

    def handle_data(self, text: str) -> None:
        if self.stack and self.stack[-1] in INSIDE and text.strip():
            self.faults.append(f"text in <{self.stack[-1]}>: {text[:40]}")
        if self._number is not None:
            self.numbers.append((*self._number, text))
            self._number = None
        if not self.stack or self.stack[-1] != "style":
            self.texts.append(text)

    @property
    def text(self) -> str:
        """All that can be read."""
        return " ".join(self.texts)

    @property
    def names(self) -> set[str]:
        """Elements and attributes that the page has."""
        return {tag for tag, _ in self.elements} | {f"@{name}" for _, about in self.elements for name in about}


def at(document: Any, pointer: str) -> Any:
    """Return what stands at a JSON pointer, whose names are as people see them."""
    for part in pointer.split("/")[1:]:
        name = part.replace("~1", "/").replace("~0", "~")
        if isinstance(document, list):
            document = document[int(name)]
        elif name in document:
            document = document[name]
        else:
            whole = {key: key.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace") for key in document}
            (document,) = [value for key, value in document.items() if visible(whole[key]) == name]
    return document


def wrong_numbers(page: Page, document: Any) -> list[str]:
    """Name each number of a page that is not what stands in its data."""
    return [
        f"{pointer}: {exact} ({shown}) is {at(document, pointer)}"
        for pointer, exact, shown in page.numbers
        if json.loads(exact) != at(document, pointer)
    ]
