"""Values -> YAML text: block style, texts quoted as JSON where they could be read as anything else; with comments.

Takes maps, lists, texts, numbers and booleans; a `Commented` value has a comment behind or above it. Pure. What comes
out is read back as the same values whatever the texts hold.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

_WIDEST = 116
_PLAIN = re.compile(r"[A-Za-z/][A-Za-z0-9_./+@-]{0,200}")
_NOT_TEXT = frozenset("y n yes no true false on off null none nan inf".split())  # noqa: SIM905 - read as words


class Commented(msgspec.Struct, frozen=True):
    """A value with a line of words beside it."""

    value: Any
    words: str


def dump(value: Mapping[str, Any], head: str = "") -> str:
    """Return the text of a document, below comment lines."""
    top = "".join(f"# {line}\n" if line else "#\n" for line in head.split("\n")) if head else ""
    return top + "\n".join(_map(value, 0)) + "\n"


def scalar(value: Any) -> str:  # noqa: ANN401 - what YAML has
    """Return one value of a line."""
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _NOT_TEXT
        return value if plain else _quoted(value)
    return json.dumps(value)


def _quoted(value: str) -> str:
    """Return a text in double quotes: JSON's escapes are YAML's too, but for characters that take two of JSON's."""
    return "".join(c if c.isprintable() else _escape(ord(c)) for c in json.dumps(value, ensure_ascii=False))


def _escape(code: int) -> str:
    if 0xD800 <= code <= 0xDFFF:
        return "\\ufffd"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def _map(value: Mapping[str, Any], depth: int) -> Iterator[str]:
    pad = "  " * depth
    for key, found in value.items():
        one, words = (found.value, found.words) if isinstance(found, Commented) else (found, "")
        if words:
            yield f"{pad}# {_one_line(words)}"
        name = scalar(key)
        if isinstance(one, Mapping) and one:
            short = _flow(one, depth, len(name))
            if short:
                yield f"{pad}{name}: {short}"
            else:
                yield f"{pad}{name}:"
                yield from _map(one, depth + 1)
        elif isinstance(one, list) and one:
            short = _flow(one, depth, len(name))
            if short:
                yield f"{pad}{name}: {short}"
            else:
                yield f"{pad}{name}:"
                yield from _list(one, depth)
        else:
            yield f"{pad}{name}: {_empty(one)}"


def _list(items: list[Any], depth: int) -> Iterator[str]:
    pad = "  " * depth
    for item in items:
        one, words = (item.value, item.words) if isinstance(item, Commented) else (item, "")
        behind = f"  # {_one_line(words)}" if words else ""
        if isinstance(one, Mapping) and one:
            first, *rest = _map(one, depth + 1)
            yield f"{pad}- {first[2 * depth + 2 :]}" if not first.lstrip().startswith("#") else f"{pad}-\n{first}"
            yield from rest
        else:
            yield f"{pad}- {_empty(one)}{behind}"


def _flow(value: Any, depth: int, used: int) -> str:  # noqa: ANN401 - what YAML has
    """Return a small collection in one line; nothing when it is not small."""
    if not _small(value):
        return ""
    text = _flow_text(value)
    return text if 2 * depth + used + len(text) < _WIDEST else ""


def _small(value: Any) -> bool:  # noqa: ANN401 - what YAML has
    if isinstance(value, Mapping):
        return len(value) <= 5 and all(
            not isinstance(one, Mapping | Commented) and _small(one) for one in value.values()
        )
    if isinstance(value, list):
        return len(value) <= 12 and all(not isinstance(one, Mapping | list | Commented) for one in value)
    return True


def _flow_text(value: Any) -> str:  # noqa: ANN401 - what YAML has
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{scalar(key)}: {_flow_text(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow_text(one) for one in value) + "]"
    return scalar(value)


def _empty(value: Any) -> str:  # noqa: ANN401 - what YAML has
    return _flow_text(value) if isinstance(value, Mapping | list) else scalar(value)


def _one_line(words: str) -> str:
    return "".join(c if c.isprintable() else " " for c in words)
