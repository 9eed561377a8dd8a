"""YAML text -> how it is written: every value as it stands there, with the comments and empty lines around it.

Takes text that `loader` has read; gives a tree for `form.py`. Pure. A comment belongs to what follows it, to what it
stands beside, or to the end of the map or list that it is indented like.
"""

from __future__ import annotations

import re
from bisect import bisect, bisect_left
from typing import Any

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc.written import BLOCK_HEADER, Document, Entry, Group, Words, Written, found_comments, split

_ODD = re.compile("[\x85\u2028\u2029]")
_TAGS = "tag:yaml.org,2002:"


def read(text: str, file: str) -> Document:
    """Read how a document is written.

    Raises:
        DefinitionError: It has a directive, or line ends that editors do not see.
    """
    lines = split(text)
    for number, line in enumerate(lines, 1):
        if odd := _ODD.search(line):
            raise _refused(
                file, number, odd.start() + 1, f"U+{ord(odd[0]):04X} ends a line in YAML, and not in editors"
            )
    return _Reader(lines, file).document()


def comments(text: str) -> list[str]:
    """Return all comments of a document, sorted."""
    return sorted(words for _, words in _Reader(split(text), "").comments.values())


def _refused(file: str, line: int, column: int, why: str) -> DefinitionError:
    return DefinitionError(
        [Diagnostic(Location(file, line, column), f"cannot be brought into form: {why}", code=Code.YAML)]
    )


class _Reader:
    def __init__(self, lines: list[str], file: str) -> None:
        import yaml

        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        self.lines, self.file = lines, file
        text = "\n".join([*lines, ""])
        scalars: list[Any] = [one for one in yaml.scan(text, Loader=loader) if type(one).__name__ == "ScalarToken"]
        self.comments = dict(found_comments(lines, scalars))
        """Line -> column and words of what is not placed yet."""
        self.rows = sorted(self.comments)
        self.scalars = iter(scalars)
        self.events: list[Any] = list(yaml.parse(text, Loader=loader))
        self.at = 0
        self.line = -1
        """The last line whose comments are placed, but for one behind what stands there."""
        self.moved: list[str] = []
        """Comments from places where none can stand; they go above the entry."""
        self.anchors = False

    def document(self) -> Document:
        """Read all of it."""
        self.at, start = 2, self.events[1]
        if start.version or start.tags:
            raise _refused(self.file, start.start_mark.line + 1, 1, "it has a directive")
        head: list[str] = []
        if start.explicit:
            mark = start.start_mark.line
            head = self._until(mark)
            self.line = mark
        first = self._peek()
        above = self._until(first.start_mark.line)
        root = self._item(-1)
        end = [*self.moved, *self._until(len(self.lines))]
        if start.explicit and isinstance(root, Group) and root.entries:
            root.entries[0].above[:0] = above
            above = []
        return Document(root, [*head, *above], start.explicit, end, self.anchors)

    def _peek(self) -> Any:  # noqa: ANN401 - PyYAML's events have no common typed base
        return self.events[self.at]

    def _until(self, line: int) -> list[str]:
        """Return comments that are not placed, and empty lines, before a line."""
        found = []
        for number in range(max(self.line, 0), line):
            if number in self.comments:
                found.append(self.comments.pop(number)[1])
            elif number > self.line and not self.lines[number].strip():
                found.append("")
        self.line = max(self.line, line - 1)
        return found

    def _inline(self, line: int) -> str:
        return self.comments.pop(line)[1] if line in self.comments else ""

    def _behind(self, mark: Any) -> str:  # noqa: ANN401 - a mark of PyYAML
        """Return the comment behind what ends at a mark, if only a comma stands between."""
        if (found := self.comments.get(mark.line)) is None:
            return ""
        between = self.lines[mark.line][mark.column : found[0]]
        return self._inline(mark.line) if mark.column <= found[0] and not between.strip(" \t,") else ""

    def _item(self, outer: int) -> Written:
        """Read the next value; `outer` is the column of the map or list around it."""
        event = self._peek()
        self.at += 1
        name, prefix = type(event).__name__, _prefix(event)
        self.anchors |= bool(getattr(event, "anchor", None))
        if name == "AliasEvent":
            self.line = max(self.line, event.end_mark.line)
            return Words(lines=[f"*{event.anchor}"], style="*", beside=self._behind(event.end_mark))
        if name == "ScalarEvent":
            return self._words(event, prefix)
        group = Group(prefix=prefix, is_map=name == "MappingStartEvent", flow=bool(event.flow_style))
        if group.flow or prefix:  # else its first entry begins where it does
            self.line = max(self.line, event.start_mark.line)
        return self._flow(group) if group.flow else self._block(group, event, outer)

    def _words(self, event: Any, prefix: str) -> Words:  # noqa: ANN401 - an event of PyYAML
        plain = event.style in (None, "")
        if plain and event.value == "":
            self.line = max(self.line, event.end_mark.line)
            return Words(prefix=prefix, beside=self._behind(event.end_mark))
        token = next(self.scalars)
        start, end, style = token.start_mark, token.end_mark, token.style or ""
        if self.line < start.line and event.start_mark.line < start.line:
            self.moved += filter(None, self._until(start.line))  # between a tag and what it is for
        self.line = max(self.line, start.line)
        if style in ("|", ">"):
            return self._block_scalar(event.value, prefix, style, start, end)
        rows = self.lines[start.line : end.line + 1]
        rows[-1] = rows[-1][: end.column]
        rows[0] = rows[0][start.column :]
        lines = [rows[0], *(row.lstrip(" \t") for row in rows[1:])]
        self.line = max(self.line, end.line)
        return Words(prefix, self._behind(end), [row.rstrip(" \t") for row in lines], style, event.value)

    def _block_scalar(self, value: str, prefix: str, style: str, start: Any, end: Any) -> Words:  # noqa: ANN401 - marks
        beside = self._inline(start.line)
        rows = self.lines[start.line + 1 : end.line]
        while rows and not value.endswith("\n\n") and not rows[-1].strip():
            rows.pop()
        self.line = start.line + len(rows)
        header = BLOCK_HEADER.match(self.lines[start.line], start.column)
        assert header is not None
        filled = next((row for row in rows if row.strip()), "")
        if style == ">" and (value.endswith("\n\n") or header[1].strip("-") or not filled):
            style = "|"  # as it is folded: whose indentation is told by a number, or whose last lines count
        if style == "|":
            return Words(prefix, beside, value.split("\n"), style, value)
        indent = len(filled) - len(filled.lstrip(" "))
        return Words(prefix, beside, [row[indent:] for row in rows], style, value)

    def _flow(self, group: Group) -> Group:
        kind = "MappingEndEvent" if group.is_map else "SequenceEndEvent"
        while type(self._peek()).__name__ != kind:
            group.entries.append(self._entry(group, -1))
        mark = self._peek().end_mark
        self.at += 1
        group.end = self._until(mark.line)
        if group.entries:
            group.commented |= any(group.end)
        else:
            self.moved += filter(None, group.end)
            group.end = []
        self.line = max(self.line, mark.line)
        group.beside = self._behind(mark)
        return group

    def _block(self, group: Group, event: Any, outer: int) -> Group:  # noqa: ANN401 - an event of PyYAML
        kind = "MappingEndEvent" if group.is_map else "SequenceEndEvent"
        first = self._peek().start_mark
        column = first.column if group.is_map else event.start_mark.column
        if group.prefix:
            column = first.column - (0 if group.is_map else 2)
            if first.line > event.start_mark.line:
                group.beside = self._inline(event.start_mark.line)
        while type(self._peek()).__name__ != kind:
            group.entries.append(self._entry(group, column))
        self.at += 1
        group.end = self._end(column if column > outer else outer + 1)
        return group

    def _entry(self, group: Group, column: int) -> Entry:
        """Read an entry, with what stands above it."""
        kept, self.moved = self.moved, []
        start = self._peek().start_mark
        above = self._until(start.line)
        entry = Entry(Words())
        if group.is_map:
            key = self._item(column)
            assert isinstance(key, Words)
            entry.key = key
            behind, key.beside = key.beside, ""
            after, ahead = self._peek().start_mark, self._peek()
            if after.line > start.line and not behind:
                behind = self._inline(start.line)
            if not _is_group(ahead) or ahead.flow_style or _prefix(ahead):
                self.moved += filter(None, self._until(after.line))
            entry.value = self._item(column)
            if behind and entry.value.beside:
                self.moved.append(behind)
            elif behind:
                entry.value.beside = behind
        else:
            entry.value = self._item(column)
        entry.above = [*above, *self.moved]
        self.moved = kept
        group.commented |= any(entry.above) or bool(entry.value.beside) or getattr(entry.value, "commented", False)
        return entry

    def _end(self, column: int) -> list[str]:
        """Return the comments behind the last entry that are indented like it."""
        at = self.at
        while _ends_group(self.events[at]):
            at += 1
        over = type(self.events[at]).__name__ == "DocumentEndEvent"
        line = len(self.lines) if over else self.events[at].start_mark.line
        last = self.line
        for number in self.rows[bisect(self.rows, self.line) : bisect_left(self.rows, line)]:
            if number in self.comments:
                if self.comments[number][0] < column:
                    break
                last = number
        return self._until(last + 1) if last > self.line else []


def _is_group(event: Any) -> bool:  # noqa: ANN401 - an event of PyYAML
    return type(event).__name__ in ("MappingStartEvent", "SequenceStartEvent")


def _ends_group(event: Any) -> bool:  # noqa: ANN401 - an event of PyYAML
    return type(event).__name__ in ("MappingEndEvent", "SequenceEndEvent")


def _prefix(event: Any) -> str:  # noqa: ANN401 - an event of PyYAML
    tag, anchor = getattr(event, "tag", None), getattr(event, "anchor", None)
    words = [f"&{anchor}"] if anchor and type(event).__name__ != "AliasEvent" else []
    if tag:
        short = f"!!{tag[len(_TAGS) :]}" if tag.startswith(_TAGS) else tag
        words.append(short if short.startswith("!") else f"!<{tag}>")
    return " ".join(words)
