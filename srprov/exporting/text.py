"""A Compose file as text: JSON values -> YAML that every reader takes for the same values.

Compose replaces `$` in values by variables, and never in keys: each is doubled, but for those of a `Raw` text. What is
not a plain word is in double quotes, so that no reader takes it for a number, a date or a boolean. Pure.

Source: YAML 1.2, "Double-Quoted Style" and "Literal Style"; Compose specification, "Interpolation".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

_WORD = re.compile(r"(?:\./|/|-{0,2}[A-Za-z_])[A-Za-z0-9_./-]*|[0-9]{1,9}(?:s|ms|us)")
"""Texts that no reader takes for anything else, here or in a list between brackets."""
_WIDEST = 100
_MEANS_SOMETHING = frozenset(["true", "false", "yes", "no", "on", "off", "null", "y", "n"])
_INDENT = "  "
_NAMED = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t"}


class Raw(str):
    """A text in which `${NAME}` is meant as Compose reads it."""

    __slots__ = ()


def dump(value: Mapping[str, object], comment: str = "") -> str:
    """Return a document; each line of the comment stands at its head."""
    head = [f"# {_one_line(line)}".rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_map(value, "")]) + "\n"


def _map(value: Mapping[str, object], indent: str) -> Iterator[str]:
    for key, one in value.items():
        yield from _entry(f"{indent}{_scalar(Raw(key))}:", one, indent)


def _list(value: Sequence[object], indent: str) -> Iterator[str]:
    for one in value:
        if isinstance(one, Mapping) and one:
            first, *rest = _map(one, indent + _INDENT)
            yield f"{indent}- {first.lstrip(' ')}"
            yield from rest
        else:
            yield from _entry(f"{indent}-", one, indent)


def _entry(head: str, value: object, indent: str) -> Iterator[str]:
    """Return a key or a list's dash with its value, on the same line where it is a scalar."""
    if isinstance(value, Mapping) and value:
        yield head
        yield from _map(value, indent + _INDENT)
    elif isinstance(value, list | tuple) and value:
        short = _in_brackets(value)
        yield f"{head} {short}".rstrip(" ")
        yield from _list(value, indent + _INDENT) if not short else ()
    elif isinstance(value, str) and (lines := _block(value)):
        yield f"{head} {lines[0]}"
        yield from (f"{indent}{_INDENT}{line}" if line else "" for line in lines[1:])
    else:
        yield f"{head} {_scalar(value)}"


def _in_brackets(values: Sequence[object]) -> str:
    """Return a list of short words on one line; nothing where it would be too long, or holds more than words."""
    if any(isinstance(one, Mapping | list | tuple) or (isinstance(one, str) and "\n" in one) for one in values):
        return ""
    line = f"[{', '.join(map(_scalar, values))}]"
    return line if len(line) <= _WIDEST else ""


def _block(text: str) -> list[str]:
    """Return a text of several lines as a literal block, its mark first; nothing where only quotes keep it as it is."""
    body = text.removesuffix("\n")
    lines = body.split("\n")
    fits = len(lines) > 1 and lines[0] and lines[-1] and lines[0][0] not in " \t"
    if not fits or not all(line.isprintable() for line in lines):
        return []
    doubled = body if isinstance(text, Raw) else body.replace("$", "$$")
    return ["|" if text.endswith("\n") else "|-", *doubled.split("\n")]


def _scalar(value: object) -> str:
    if isinstance(value, str):
        return _text(value if isinstance(value, Raw) else value.replace("$", "$$"))
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, Mapping):
        return "{}"
    if isinstance(value, list | tuple):
        return "[]"
    assert isinstance(value, int | float), value
    return repr(value)


def _text(text: str) -> str:
    if _WORD.fullmatch(text) and text.lower() not in _MEANS_SOMETHING:
        return text
    return '"' + "".join(map(_character, text)) + '"'


def _character(one: str) -> str:
    if one in _NAMED:
        return _NAMED[one]
    if one.isprintable():
        return one
    number = ord(one)
    return f"\\x{number:02x}" if number < 0x100 else f"\\u{number:04x}" if number < 0x10000 else f"\\U{number:08x}"


def _one_line(text: str) -> str:
    return "".join(one if one.isprintable() else " " for one in text)
