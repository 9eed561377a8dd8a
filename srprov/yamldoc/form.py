"""How a document is written -> its text in one form: two spaces, lists below their key indented, double quotes.

Takes a `Document` and the order of keys; gives text. Pure. The form is Prettier's where it can be: an
editor that uses that one changes little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from srprov.yamldoc.writer import quoted
from srprov.yamldoc.written import Document, Group, Words, Written

WIDTH = 120
"""Of a list or map in one line."""
Path = tuple[str, ...]
Orders = Callable[[Path], Sequence[str]]
"""The order of the keys of the map at a path; keys that are not in it come last, as they stood."""


def text_of(document: Document, orders: Orders) -> str:
    """Return a document's text."""
    root = document.root
    if not document.anchors:  # an alias stands behind its anchor
        _sort(root, (), orders)
    lines = _tidy(document.head)
    if document.marked and isinstance(root, Group) and not (root.flow or root.prefix):
        lines += ["---", *_value("", root, "")]
    else:
        lines += _value("---" if document.marked else "", root, "")
    end = _tidy(document.end, first=False)
    while end and not end[-1]:
        end.pop()
    return "\n".join([*lines, *end, ""])


def _tidy(above: Sequence[str], *, first: bool = True) -> list[str]:
    """Return comments and empty lines, of which no two follow each other and none comes first."""
    made: list[str] = []
    for one in above:
        if one or (made[-1] if made else not first):
            made.append(one)
    return made


def _sort(value: Written, path: Path, orders: Orders) -> None:
    """Bring the keys of a map, and of maps in it, into their order; those in lists stay as they are."""
    if isinstance(value, Group) and value.is_map:
        rank = {key: at for at, key in enumerate(orders(path))}
        value.entries.sort(key=lambda one: rank.get(one.key.value if one.key else "", len(rank)))
        for one in value.entries:
            _sort(one.value, (*path, one.key.value if one.key else ""), orders)


def _value(head: str, one: Written, inner: str) -> Iterator[str]:
    """Yield the lines of a value behind `head`; what does not fit there is indented by `inner`."""
    if isinstance(one, Group):
        if (line := _one_line(head, one)) is not None:
            yield _joined(line, one.beside)
            return
        if head or one.prefix or one.beside:
            yield _joined(head, one.prefix, one.beside)
        yield from _entries(one, inner)
    elif isinstance(one, Words):
        yield from _words(head, one, inner)


def _entries(group: Group, indent: str) -> Iterator[str]:
    for at, one in enumerate(group.entries):
        above = [*one.above, *([] if group.is_map else _hoisted(one.value, indent))]
        yield from (f"{indent}{line}".rstrip() for line in _tidy(above, first=not at))
        if one.key is None:
            yield from _item(one.value, indent)
        else:
            yield from _value(f"{indent}{_key(one.key)}", one.value, f"{indent}  ")
    yield from (f"{indent}{line}".rstrip() for line in _tidy(group.end, first=False))


def _item(value: Written, indent: str) -> Iterator[str]:
    head, inner = f"{indent}-", f"{indent}  "
    if not _begins_on(head, value):
        yield from _value(head, value, inner)
        return
    first, *rest = _value("", value, inner)
    yield f"{head} {first.removeprefix(inner)}"
    yield from rest


def _begins_on(head: str, value: Written) -> bool:
    """Return whether a map or list begins on the line of its dash, so that nothing can stand between them."""
    return isinstance(value, Group) and not value.prefix and bool(value.entries) and _one_line(head, value) is None


def _hoisted(value: Written, indent: str) -> list[str]:
    """Take what would stand between a dash and its value: it goes above the dash."""
    if not _begins_on(f"{indent}-", value) or not isinstance(value, Group):
        return []
    first = value.entries[0]
    taken = [value.beside, *first.above]
    value.beside, first.above = "", []
    if not value.is_map:
        taken += _hoisted(first.value, f"{indent}  ")
    return [one for one in taken if one]


def _joined(*words: str) -> str:
    return " ".join(word for word in words if word)


def _key(key: Words) -> str:
    # the colon could belong to the name of an alias
    return f"{_joined(key.prefix, _line(key))}{' :' if key.style == '*' else ':'}"


def _line(one: Words) -> str:
    """Return a scalar in one line."""
    if one.style in ("|", ">"):
        return quoted(one.value)
    if len(one.lines) > 1:
        return quoted(one.value) if one.style or "\n" in one.value else one.value
    line = one.lines[0] if one.lines else ""
    return f'"{one.value}"' if one.style == "'" and not set(one.value) & {'"', "\\"} else line


def _words(head: str, one: Words, inner: str) -> Iterator[str]:
    """Yield the lines of a scalar."""
    if one.style in ("|", ">") and one.value:
        yield from _block_scalar(head, one, inner)
    elif len(one.lines) > 1:
        yield _joined(head, one.prefix, one.lines[0])
        *rows, last = one.lines[1:]
        yield from (f"{inner}{row}" if row else "" for row in rows)
        yield _joined(f"{inner}{last}", one.beside)
    else:
        yield _joined(head, one.prefix, _line(one), one.beside)


def _block_scalar(head: str, one: Words, inner: str) -> Iterator[str]:
    ended, more = one.value.endswith("\n"), one.value.endswith("\n\n") or one.value == "\n"
    rows = one.lines[:-1] if one.style == "|" and ended else one.lines
    upto = next((at for at, row in enumerate(rows) if row.strip(" ")), len(rows) - 1)
    # a space at the beginning would be taken for indentation
    number = "2" if one.style == "|" and any(row.startswith(" ") for row in rows[: upto + 1]) else ""
    yield _joined(head, one.prefix, f"{one.style}{number}{'+' if more else '' if ended else '-'}", one.beside)
    yield from (f"{inner}{row}" if row else "" for row in rows)


def _one_line(head: str, group: Group) -> str | None:
    """Return a map or list that is written in one line behind `head`, or None where it is not."""
    if not group.flow or group.commented or (text := _flow(group)) is None:
        return None
    line = _joined(head, group.prefix, text)
    return line if len(line) <= WIDTH or not group.entries else None


def _flow(group: Group) -> str | None:
    """Return a map or list in one line; None when it has a key without a value, which could be read otherwise."""
    made = []
    for one in group.entries:
        words = one.value
        value = _flow(words) if isinstance(words, Group) else _line(words) if isinstance(words, Words) else ""
        if not value:
            return None
        made.append(_joined(_key(one.key) if one.key else "", words.prefix, value))
    text = ", ".join(made)
    return f"[{text}]" if not group.is_map else f"{{ {text} }}" if text else "{}"
