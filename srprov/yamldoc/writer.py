"""Values -> YAML text that `loader` reads as the same values, laid out as people write it.

Takes maps, lists, text, numbers, booleans, and `Commented` ones of them; gives block style, with short lists in one
line. Pure. A text that could be read as something else, by YAML 1.1 or 1.2, is in double quotes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

_PLAIN = re.compile(r"[A-Za-z0-9_./~$^@%+=,<>()-][A-Za-z0-9_./~$^@%+=,<>():;!&*?| \"'\\-]*", re.ASCII)
_INDICATOR = re.compile(r"-(?!\S)|[?:,\[\]{}#&*!|>'\"%@`=<]|~\Z")
_WORD = re.compile(r"(true|false|yes|no|on|off|y|n|null|none|~|[-+]?\.(inf|nan))", re.IGNORECASE)
_NUMBER = re.compile(r"(?=.*[0-9])[-+.0-9][0-9a-fA-FxXoO_.:,eE+-]*|[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}[Tt ].*")
"""Or a point in time."""
_LONGEST_FLOW = 100
_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}


class Commented(msgspec.Struct, frozen=True):
    """A value with words beside it: above it in a map, behind it in a list."""

    value: Any
    words: str


def document(value: Mapping[str, Any], comment: str = "") -> str:
    """Return a document; `comment` is text that stands before it."""
    head = [_comment(line).rstrip() for line in comment.splitlines()]
    return "\n".join([*head, *_block(value, "")]) + "\n"


def scalar(value: object) -> str:
    """Return a value that holds no others, in one line."""
    if isinstance(value, bool) or value is None:
        return "null" if value is None else str(value).lower()
    if isinstance(value, int | float):
        return str(value)
    text = str(value)
    return text if _is_plain(text) else quoted(text)


def quoted(text: str) -> str:
    """Return text in double quotes; what is not printable is escaped."""
    return '"' + "".join(_ESCAPES.get(one) or (one if one.isprintable() else _escaped(one)) for one in text) + '"'


def _escaped(letter: str) -> str:
    code = ord(letter)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _is_plain(text: str) -> bool:
    """Return whether text may stand without quotes, also inside of a list in one line."""
    return (
        _PLAIN.fullmatch(text) is not None
        and not _INDICATOR.match(text)
        and not _WORD.fullmatch(text)
        and not _NUMBER.fullmatch(text)
        and ": " not in text
        and " #" not in text
        and text[-1] not in ": "
        and not set(text) & set(",[]{}?")
        and not text.startswith(("---", "..."))
    )


def _block(value: Mapping[str, Any], indent: str) -> Iterator[str]:
    for key, found in value.items():
        one, words = _apart(found)
        if words:
            yield f"{indent}{words}"
        yield from _entry(f"{indent}{scalar(str(key))}:", one, indent)


def _apart(value: object) -> tuple[object, str]:
    """Return a value and the comment beside it, or nothing."""
    return (value.value, _comment(value.words)) if isinstance(value, Commented) else (value, "")


def _comment(words: str) -> str:
    return "# " + "".join(one if one.isprintable() else " " for one in words)


def _entry(head: str, value: object, indent: str) -> Iterator[str]:
    """Yield the lines of one value after what stands before it."""
    if isinstance(value, Mapping) and value:
        yield head
        yield from _block(value, f"{indent}  ")
    elif isinstance(value, list | tuple) and value:
        if flow := _flow(value, len(head)):
            yield f"{head} {flow}"
            return
        yield head
        for one in value:
            yield from _item(one, f"{indent}  ")
    elif isinstance(value, str) and _is_script(value):
        yield f"{head} |{'' if value.endswith(chr(10)) else '-'}"
        yield from (f"{indent}  {line}".rstrip() for line in value.removesuffix("\n").split("\n"))
    else:
        yield f"{head} {_empty(value)}"


def _empty(value: object) -> str:
    return "{}" if isinstance(value, Mapping) else "[]" if isinstance(value, list | tuple) else scalar(value)


def _item(value: object, indent: str) -> Iterator[str]:
    one, words = _apart(value)
    if isinstance(one, Mapping) and one:
        first, *rest = _block(one, f"{indent}  ")
        yield from [f"{indent}{words}"] if words else []
        yield from (f"{indent}-", first) if first.lstrip().startswith("#") else (f"{indent}- {first.lstrip()}",)
        yield from rest
        return
    lines = list(_entry(f"{indent}-", one, indent))
    if not words:
        yield from lines
    elif len(lines) == 1:
        yield f"{lines[0]}  {words}"
    else:
        yield from (f"{indent}{words}", *lines)


def _flow(value: list[Any] | tuple[Any, ...], before: int) -> str:
    """Return a list of short words in one line, or nothing."""
    if any(isinstance(one, Mapping | list | tuple | Commented) or "\n" in str(one) for one in value):
        return ""
    text = f"[{', '.join(scalar(one) for one in value)}]"
    return text if before + len(text) < _LONGEST_FLOW else ""


def _is_script(text: str) -> bool:
    """Return whether text with several lines reads the same as a literal block."""
    lines = text.split("\n")
    ended = text.endswith("\n") and not text.endswith("\n\n")
    return (
        len(lines) > 1
        and lines[0][:1] not in ("", " ", "\t")
        and (ended or lines[-1] != "")
        # what is not printable may be a line's end to some readers
        and all(line.replace("\t", " ").isprintable() and line == line.rstrip() for line in lines)
    )
