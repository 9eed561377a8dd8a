"""What a secret looks like in a text, and the text without it.

Takes values and texts, gives texts. A value is found in every form that a program may print it in: itself, quoted for
JSON, URLs, Python or a shell, base64 and base32 (what stands before a value shifts its bits, so each has several), hex;
and where lines were wrapped inside of any of them. What is done is linear in the text, whatever it is.

Source: RFC 4648; `base64` wraps its lines, `xxd -p`, `openssl` and fingerprints put blanks or colons between bytes.
"""

from __future__ import annotations

import base64
import bisect
import functools
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from srprov.redaction_bytes import HEAD, places, search

SHORTEST = 4
"""Characters of a secret. A shorter one would be found in every other line, and blank out the whole output."""
MASK = "***"
_SHORTEST_PART = 8
"""Characters of a line of a long secret (a key in PEM) that is looked for by itself."""
_SHORTEST_SHIFTED = 6
_WRAP = re.compile(r"\r?(?:\n|(?:\\r)?\\n)[ \t\r\n]*")
"""A line's end, also as JSON writes it, with the indentation of the next one."""
_QUOTES = re.compile(r"""['"\\]""")
_SEPARATED = re.compile(r"(?:[0-9a-fA-F](?:[\s:,%-]|\\x)*){7,}[0-9a-fA-F]")
_SEPARATOR = re.compile(r"(?:[\s:,%-]|\\x)+")

Span = tuple[int, int]


def in_bytes(value: str) -> bytes:
    """Return the bytes of a value; those that are no UTF-8 arrived as surrogates."""
    return value.encode("utf-8", "surrogateescape")


def forms(value: str) -> frozenset[str]:
    """Return every text that a value is looked for as, but for wraps and separators."""
    raw = in_bytes(value)
    found = {*_hex(value), *_encoded(raw)}
    for text in {value, value.strip(), raw.decode("utf-8", "replace").strip()}:
        found |= set(_escaped(text))
    lines = value.splitlines()
    if len(lines) > 1:
        parts = {line.strip() for line in lines}
        found |= {form for part in parts if len(part) >= _SHORTEST_PART for form in (part, *_encoded(in_bytes(part)))}
    return frozenset(form for form in found if len(form.strip()) >= SHORTEST)


def _hex(value: str) -> set[str]:
    raw = in_bytes(value)
    return {one.hex() for one in (raw, raw.strip())} | {hashlib.sha256(raw).hexdigest()}


def _encoded(raw: bytes) -> Iterator[str]:
    """Return base64 and base32 of a value alone, and what of it is fixed when other bytes stand before it."""
    for text in (*_shifted(raw, base64.b64encode, 6, 3), base64.b64encode(raw.strip()).decode("ascii").rstrip("=")):
        yield text
        yield text.replace("+", "-").replace("/", "_")
    for text in (*_shifted(raw, base64.b32encode, 5, 5), base64.b32encode(raw.strip()).decode("ascii").rstrip("=")):
        yield text
        yield text.lower()


def _shifted(raw: bytes, encode: Callable[[bytes], bytes], bits: int, period: int) -> Iterator[str]:
    """Return what each alignment makes of a value; `bits` per character, which repeats after `period` bytes."""
    yield encode(raw).decode("ascii").rstrip("=")
    for before in range(period):
        # a character that also holds bits of a neighbour differs with it
        first, last = -(-8 * before // bits), 8 * (before + len(raw)) // bits
        if last - first >= _SHORTEST_SHIFTED:
            yield encode(b"\0" * before + raw).decode("ascii")[first:last]


def _escaped(text: str) -> Iterator[str]:
    import html
    import json
    import shlex
    from urllib.parse import quote

    yield text
    yield json.dumps(text)[1:-1]
    yield json.dumps(text, ensure_ascii=False)[1:-1]
    yield json.dumps(json.dumps(text))[3:-3]
    for safe in ("", "/"):
        quoted = quote(in_bytes(text), safe=safe)
        yield from (quoted, quoted.replace("%20", "+"), _lower(quoted))
    yield repr(text)[1:-1]
    yield repr(in_bytes(text))[2:-1]
    yield text.encode("unicode_escape").decode("ascii")
    yield from (html.escape(text), html.escape(text, quote=False))
    yield shlex.quote(text).strip("'")
    yield re.sub(r"([\\`*_{}\[\]()<>#+\-!|~@])", r"\\\1", text)  # Markdown


def _lower(quoted: str) -> str:
    """Write `%2F` as `%2f`: RFC 3986 allows both."""
    first, *rest = quoted.split("%")
    return "%".join([first, *(part[:2].lower() + part[2:] for part in rest)])


class _Forms:
    """Texts to look for. What that costs follows from whole forms in a text, never from how one begins.

    A robot that says much sees how fast that is taken: of a guess at the first letters of another one's password, it
    would learn whether it is right, and go on from there.
    """

    def __init__(self, found: Iterable[str]) -> None:
        self._every = sorted(map(_distinct, set(found)))
        by_start: dict[bytes, list[bytes]] = {}
        for form in self._every:
            by_start.setdefault(form[:SHORTEST], []).append(form)
        self._by_start: Mapping[bytes, list[bytes]] = by_start

    @functools.cached_property
    def _places(self) -> Callable[[bytes], Iterator[int]]:
        return places(self._every)

    def stand_in(self, text: str) -> bool:
        """Tell whether a form stands in a text, or may."""
        return any(True for _ in self._places(_distinct(text)))

    def spans(self, text: str) -> list[Span]:
        """Return every place where a form stands."""
        data = _distinct(text)
        found, length = list[Span](), len(data)
        effort = 16 * length + (1 << 20)
        for at in self._places(data):
            for form in self._by_start.get(data[at : at + SHORTEST], ()):
                if not data.startswith(form[:HEAD], at):
                    continue
                effort -= min(len(form), length - at)
                if effort < 0:  # a text made of half secrets: rather none of it than a search without end
                    return [(0, len(text))]
                if data.startswith(form, at):
                    found.append((at, at + len(form)))
        return _in_characters(text, data, found)


def _distinct(text: str) -> bytes:
    """Return bytes for a text that no other text has."""
    return text.encode("utf-8", "surrogatepass")


def _in_characters(text: str, data: bytes, found: list[Span]) -> list[Span]:
    """Return places in a text for those in its bytes."""
    if len(text) == len(data):
        return found
    place, characters, before = {}, 0, 0
    for at in sorted({at for span in found for at in span}):
        characters += len(data[before:at].decode("utf-8", "surrogatepass"))
        place[at] = characters
        before = at
    return [(place[start], place[stop]) for start, stop in found]


class _View:
    """A part of a text without some of its characters, in which forms are looked for."""

    def __init__(self, text: str, without: re.Pattern[str], start: int = 0, end: int | None = None) -> None:
        self._text, self._without = text, without
        self._start, self._end = start, len(text) if end is None else end
        self.text = without.sub("", text[self._start : self._end])

    def spans(self, found: Iterable[Span]) -> list[Span]:
        """Return where spans of the view were, with what was left out between."""
        spans = list(found)
        if not spans:
            return []
        ends, moved = self._map()

        def place(at: int) -> int:
            return at + moved[min(bisect.bisect_right(ends, at), len(moved) - 1)]

        return [(place(start), place(stop - 1) + 1) for start, stop in spans]

    def _map(self) -> tuple[list[int], list[int]]:
        """Return for each piece of the view its end, and how far it was moved."""
        ends, moved, length, at = [], [], 0, self._start
        for gap in self._without.finditer(self._text, self._start, self._end):
            length += gap.start() - at
            ends.append(length)
            moved.append(gap.start() - length)
            at = gap.end()
        return [*ends, length + self._end - at], [*moved, at - length]


class Known:
    """Every form of every secret."""

    def __init__(self, found: Mapping[str, frozenset[str]] | None = None) -> None:
        """Know values by their forms; a Known never changes, as threads may be using it."""
        self._found = dict(found or {})
        plain = {form for each in self._found.values() for form in each}
        wrapped = {_WRAP.sub("", form.strip()) for form in plain}
        self._texts = _Forms(plain | {form for form in wrapped if len(form) >= SHORTEST})
        self._hex = _Forms({form for value in self._found for form in _hex(value) if len(form) >= 2 * SHORTEST})

    def plus(self, found: Mapping[str, frozenset[str]]) -> Known:
        """Return one that knows other values too, each with its forms."""
        return self if found.keys() <= self._found.keys() else Known({**self._found, **found})

    def __bool__(self) -> bool:
        """Tell whether there is anything to look for."""
        return bool(self._found)

    @functools.cached_property
    def stands_in(self) -> Callable[[bytes], bool]:
        """Tell whether any form stands in bytes as it is, without wraps and separators between."""
        return search({form for each in self._found.values() for form in each})

    def _spans(self, text: str) -> list[Span]:
        """Return every place of a secret, in order."""
        found = self._texts.spans(text)
        if "\n" in text or "\\n" in text:
            view = _View(text, _WRAP)
            found += view.spans(self._texts.spans(view.text))
        runs = [_View(text, _SEPARATOR, run.start(), run.end()) for run in _SEPARATED.finditer(text)]
        if runs and self._hex.stand_in("\n".join(view.text for view in runs).lower()):
            found += [one for view in runs for one in view.spans(self._hex.spans(view.text.lower()))]
        return sorted(found)

    def masks(self, text: str) -> list[Span]:
        """Return what of a text is not to be shown, in order; a line's end that a secret ends with stays one."""
        masks: list[Span] = []
        for start, found in self._spans(text):
            stop = start + len(text[start:found].rstrip("\r\n"))
            if masks and start <= masks[-1][1]:  # what overlaps or touches the one before is one mask with it
                masks[-1] = masks[-1][0], max(masks[-1][1], stop)
            else:
                masks.append((start, stop))
        return masks

    def without(self, text: str, *, for_people: bool = False) -> str:
        """Return a text with every secret as `***`.

        A message for people may have a command: behind a secret that takes a quote with it, no quotes hold any more.
        """
        parts, end, lines = list[str](), 0, f"{text}\n"
        for start, stop in self.masks(text):
            if stop > end:
                parts += [text[end:start], MASK]
                takes_quotes = for_people and _QUOTES.search(text, start, stop)
                end = lines.index("\n", stop) if takes_quotes else stop
        return "".join([*parts, text[end:]]) if parts else text
