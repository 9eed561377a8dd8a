"""YAML text -> nodes with their places; the one way in which YAML that users write is read.

Takes a path or text; returns the document's root `Node`. Touches files, for reading. It walks the parser's events
itself (libyaml's parser where PyYAML has it) and never builds Python objects from tags, so that: a duplicate key is
an error; how much a document may hold once its aliases are followed, and how deep it may nest, is limited before
memory or the C stack is used up; an alias is shown where it is used.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.yamldoc.allowance import Allowance, current
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq, Source
from srprov.yamldoc.syntax import LINE_END, MAX_DEPTH, TOO_DEEP, explained

MAX_BYTES = 8 * 1024 * 1024
MAX_NODES = 200_000
"""Nodes of one document after aliases are followed; an inventory of a thousand robots needs a tenth."""
_MOST_REPEATED = 2 * 1024 * 1024
"""Characters that aliases of a document alone stand for; of several files they count as if they were written out."""

_MOST_DIRECTIVES = 100
"""The parser compares each with all others."""

_IN_WORDS: dict[type[OSError], str] = {
    IsADirectoryError: "it is a folder",
    **dict.fromkeys((FileNotFoundError, NotADirectoryError), "there is no such file"),
}
_YAML_TAGS = "tag:yaml.org,2002:"


def read(path: str | FilePath, shown: str = "") -> Node | None:
    """Read one file; None when it holds no document.

    Raises:
        DefinitionError: It cannot be read, is no UTF-8, no YAML, or breaks a limit.
    """
    return parse(read_text(path, shown), shown or str(path))


def read_text(
    path: str | FilePath, shown: str = "", most: int = MAX_BYTES, *, real: bool = False, known_as: str = "",
    times: int = 1,
) -> str:  # fmt: skip
    """Read a file's text (UTF-8, no byte order mark) of at most `most` bytes; the errors are those of `read`.

    What may be meant by a file that is not there is told where the user named it, not where another file did, which is
    what `shown` is for: names beside it may be none of that file's business.

    `real` is as for `regular_file.read`; `known_as` is the path by which the content is kept, if that is another;
    `times` is how often its bytes count among those of all files, by how often it is gone through.
    """
    name = shown or str(path)
    try:
        data = regular_file.read(path, most, real=real)
        if left := current.get():
            left.bytes -= times * len(data)
            left.contents[known_as or str(path)] = data
            if left.bytes < 0:
                together = f"with it, all files that belong together are larger than {left.most_bytes >> 20} MiB"
                raise OSError(errno.EFBIG, f"{together}, where it counts {times} times" if times > 1 else together)
    except OSError as error:
        reason = _IN_WORDS.get(type(error), error.strerror)
        near = regular_file.names_beside(path) if isinstance(error, FileNotFoundError) and not shown else []
        hint = did_you_mean(FilePath(path).name, near)
        raise DefinitionError(
            [Diagnostic(Location(name), f"cannot be read: {reason}", hint=hint, code=Code.UNREADABLE)]
        ) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        start = data[: error.start]
        line, column = start.count(b"\n") + 1, error.start - (start.rfind(b"\n") + 1) + 1
        place = Location(name, line, column)
        raise DefinitionError(
            [Diagnostic(place, "is not UTF-8 text", hint="save the file as UTF-8", code=Code.UNREADABLE)]
        ) from None


def parse(text: str, file: str) -> Node | None:
    """Read YAML text; `file` is what problems are shown with. None when it holds no document.

    Raises:
        DefinitionError: With all duplicate keys, a hundred at most, or the first place where the text is no YAML.
    """
    import yaml

    source = Source(file, tuple(LINE_END.split(text)))
    if sum(line.startswith("%") for line in source.lines) > _MOST_DIRECTIVES:
        told = f"has more than {_MOST_DIRECTIVES} lines that begin with '%', as directives do"
        raise DefinitionError([Diagnostic(Location(file), told, code=Code.TOO_LARGE)])
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        return _Composer(source, yaml.parse(text, Loader=loader)).document()
    except yaml.YAMLError as error:
        raise DefinitionError([explained(source, text, error)]) from None


class _Composer:
    """Builds nodes from events; depth and count are checked before anything is built."""

    def __init__(self, source: Source, events: Iterator[Any]) -> None:
        self.source = source
        self.events = events
        self.allowance = current.get() or Allowance(_MOST_REPEATED, MAX_NODES)
        self.most = min(self.allowance.values, MAX_NODES)
        self.anchors: dict[str, Node] = {}
        self.sizes: dict[str, tuple[int, int, int]] = {}
        """anchor -> how many values and characters it stands for, and how many levels it nests"""
        self.count = 0
        self.letters = 0
        """Characters of all values, also after aliases are followed."""
        self.deepest = 0
        self.findings = Findings()

    def document(self) -> Node | None:
        """Return the root of the only document."""
        try:
            root = self._root()
        finally:
            self.allowance.values -= self.count
        if self.findings.problems:
            raise DefinitionError(self.findings.problems)
        empty = isinstance(root, Scalar) and root.plain and root.text == "" and not root.tag
        return None if empty else root

    def _root(self) -> Node | None:
        root: Node | None = None
        for event in self.events:
            if type(event).__name__ == "DocumentStartEvent":
                if root is not None:
                    raise self._stop(event, "a second document begins here; a file holds one")
                root = self._node(next(self.events), 0)
        return root

    def _node(self, event: Any, depth: int) -> Node:  # noqa: ANN401 - PyYAML's events have no common typed base
        name = type(event).__name__
        line, column = event.start_mark.line + 1, event.start_mark.column + 1
        if name == "AliasEvent":
            return self._alias(event, line, column, depth)
        self.count += 1
        if self.count > self.most:
            raise self._stop(event, f"the document holds more than {self.most} values", Code.TOO_LARGE)
        if depth > MAX_DEPTH:
            raise self._stop(event, TOO_DEEP, Code.TOO_LARGE)
        before, letters, outer, self.deepest = self.count, self.letters, self.deepest, depth
        tag = _own_tag(event.tag)
        node: Node
        if name == "ScalarEvent":
            if "\0" in event.value:
                raise self._stop(event, "holds a NUL character, which no file, command or variable can")
            self.letters += len(event.value)
            plain = (event.style in (None, "") and event.tag is None) or event.tag in _PLAIN_TAGS
            node = Scalar(self.source, line, column, event.value, plain, tag)
        elif name == "SequenceStartEvent":
            node = Seq(self.source, line, column, tuple(self._items(depth)), tag)
        else:
            node = self._map(line, column, tag, depth)
        if event.anchor:
            self.anchors[event.anchor] = node
            self.sizes[event.anchor] = (self.count - before + 1, self.letters - letters, self.deepest - depth)
        self.deepest = max(outer, self.deepest)
        return node

    def _items(self, depth: int) -> Iterator[Node]:
        for event in self.events:
            if type(event).__name__ == "SequenceEndEvent":
                return
            yield self._node(event, depth + 1)

    def _map(self, line: int, column: int, tag: str, depth: int) -> Map:
        entries: dict[str, Node] = {}
        keys: dict[str, Scalar] = {}
        merged: list[Map] = []
        for event in self.events:
            if type(event).__name__ == "MappingEndEvent":
                break
            key = self._node(event, depth + 1)
            value = self._node(next(self.events), depth + 1)
            if not isinstance(key, Scalar) or key.tag:
                self.findings.add(key, "a key must be a single word or text", code=Code.YAML)
            elif key.text == "<<" and key.plain:
                merged.extend(self._merge_sources(value))
            elif key.text in entries:
                first = keys[key.text].line
                told = f"duplicate key '{key.text}'; it is already on line {first}"
                self.findings.add(key, told, (key.text,), code=Code.TWICE)
            else:
                entries[key.text], keys[key.text] = value, key
        for other in merged:
            self.count += len(other.entries)
            for text, inherited in other.entries.items():
                if text not in entries:
                    entries[text], keys[text] = inherited, other.keys[text]
        return Map(self.source, line, column, entries, keys, tag)

    def _merge_sources(self, value: Node) -> list[Map]:
        maps = list(value.items) if isinstance(value, Seq) else [value]
        for node in maps:
            if not isinstance(node, Map):
                self.findings.add(node, "'<<' merges maps only", code=Code.YAML)
        return [node for node in maps if isinstance(node, Map)]

    def _alias(self, event: Any, line: int, column: int, depth: int) -> Node:  # noqa: ANN401 - as _node
        node = self.anchors.get(event.anchor)
        if node is None:
            raise self._stop(event, f"'*{event.anchor}' stands for nothing here; no '&{event.anchor}' ends before it")
        size, letters, height = self.sizes[event.anchor]
        self.count += size
        self.letters += letters
        self.allowance.bytes -= letters
        if self.allowance.bytes < 0:
            raise self._stop(event, "the aliases stand for more text than files may have", Code.TOO_LARGE)
        self.deepest = max(self.deepest, depth + height)
        if self.count > self.most:
            raise self._stop(event, f"the aliases stand for more than {self.most} values", Code.TOO_LARGE)
        if depth + height > MAX_DEPTH:
            raise self._stop(event, TOO_DEEP, Code.TOO_LARGE)
        if isinstance(node, Scalar):
            return Scalar(self.source, line, column, node.text, node.plain, node.tag)
        if isinstance(node, Seq):
            return Seq(self.source, line, column, node.items, node.tag)
        return Map(self.source, line, column, node.entries, node.keys, node.tag)

    def _stop(self, event: Any, message: str, code: Code = Code.YAML) -> DefinitionError:  # noqa: ANN401 - as _node
        place = Location(self.source.file, event.start_mark.line + 1, event.start_mark.column + 1)
        excerpt = self.source.excerpt(place.line)
        return DefinitionError([*self.findings.problems, Diagnostic(place, message, "", excerpt, code=code)])


_PLAIN_TAGS = {_YAML_TAGS + name for name in ("int", "float", "bool", "null")}


def _own_tag(tag: str | None) -> str:
    """Keep tags that mean something to us (`!vault`); YAML's own (`!!str`, `!!map`) only say what is written anyway."""
    return "" if tag is None or tag == "!" or tag.startswith(_YAML_TAGS) else tag
