"""Files of a Compose project -> trees, and what may be read at all.

Takes paths; gives trees, or `Refused`. Reads files: those that the user named, and others only in their folders.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field

from srprov.errors import DefinitionError, Diagnostic
from srprov.importing.compose.scalars import Date, meaning
from srprov.importing.compose.values import Value, dotted
from srprov.importing.normal import Refused
from srprov.importing.position import Path, Position
from srprov.yamldoc import loader, nodes

MOST_FILES = 200
_KINDS = {bool: "a boolean", int: "a number", float: "a number", type(None): "nothing", Date: "a date"}


@dataclass
class Reading:
    """What may be read, and what was."""

    roots: tuple[str, ...]
    """Real paths of the folders that the user's own files lie in."""
    count: int = 0
    texts: dict[str, str] = field(default_factory=dict)

    def inside(self, path: str, named: Value) -> str:
        """Return the real path of a file that a file names; it must lie in a folder of the user's own files.

        Raises:
            Refused: It does not.
        """
        real = os.path.realpath(path)
        if not any(os.path.commonpath((real, root)) == root for root in self.roots):
            message = f"'{named.data}' lies outside of the project's folder, and is not read"
            raise Refused([Diagnostic(named.at, message, hint="copy it into the folder of the Compose file")])
        return real

    def text(self, path: str, shown: str, named: Value | None) -> str:
        """Return a file's text; `named` is where a file names it, None for one that the user named.

        Raises:
            Refused: It cannot be read, or must not be.
        """
        self.count += 1
        if self.count > MOST_FILES:
            place = named.at if named else Position(shown)
            raise Refused([Diagnostic(place, f"the project has more than {MOST_FILES} files")])
        try:
            real = os.path.realpath(path) if named is None else self.inside(path, named)
            return loader.read_text(real, shown, real=True)
        except ValueError:
            raise Refused([Diagnostic(Position(shown), "no file can have such a name")]) from None
        except Refused:
            raise
        except DefinitionError as error:
            raise _at(error, named) from None


def _at(error: DefinitionError, named: Value | None) -> Refused:
    """Return the refusal of a file that cannot be read, at the place where it is named."""
    if named is None:
        return Refused(error.problems)
    return Refused([Diagnostic(named.at, f"'{named.data}' {one.message}", "", "", one.hint) for one in error.problems])


def tree(text: str, shown: str) -> Value:
    """Return a Compose file's tree.

    Raises:
        Refused: It is no YAML, too large, empty, no map, or has keys that are no text.
    """
    try:
        root = loader.parse(text, shown)
    except DefinitionError as error:
        raise Refused(error.problems) from None
    if root is None:
        raise Refused([Diagnostic(Position(shown), "the file is empty")])
    problems: list[Diagnostic] = []
    value = _value(root, None, (), problems)
    if not problems and not isinstance(value.data, dict):
        problems.append(Diagnostic(value.at, "a Compose file is a map with services"))
    if problems:
        raise Refused(problems)
    return value


def _value(node: nodes.Node, key: Position | None, path: Path, problems: list[Diagnostic]) -> Value:
    at = nodes.location(node)
    tag = node.tag if node.tag in ("!reset", "!override") else ""
    if isinstance(node, nodes.Map):
        entries = {}
        for name, item in node.entries.items():
            written = node.keys[name]
            if (written.plain and not isinstance(key_means := meaning(name), str | Date)) or _is_date(written):
                what = _KINDS.get(Date if _is_date(written) else type(key_means), "no text")
                problems.append(
                    nodes.problem(written, f"the key '{name}' is {what}; a key must be text", path, "quote it")
                )
            entries[name] = _value(item, nodes.location(written), (*path, name), problems)
        return Value(entries, at, key, tag)
    if isinstance(node, nodes.Seq):
        items = [_value(item, None, (*path, number), problems) for number, item in enumerate(node.items)]
        return Value(items, at, key, tag)
    data = meaning(node.text) if node.plain and not node.tag else node.text
    if isinstance(data, Date):
        problems.append(
            nodes.problem(node, "this is a date to YAML, which Compose takes nowhere", dotted(path), "quote it")
        )
    return Value(data, at, key, tag)


def _is_date(key: nodes.Scalar) -> bool:
    return key.plain and isinstance(meaning(key.text), Date)
