"""What the values of variables are read as: once for all hosts that have one from the same place, and not without end.

Takes nodes, functions that read them, and the names that stand for a host and its folder; gives what was read.
Touches srprov's own schemas. A group's variable is every host's: ten thousand of them, and one text of ten thousand
characters, are a file of ten kilobytes, and were a hundred megabytes to read and to keep.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar, cast

from srprov.codes import Code
from srprov.definitions import schema
from srprov.definitions.groups import Variables
from srprov.errors import DefinitionError
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq

_T = TypeVar("_T")
NAMES = re.compile(r"\{\{\s*(inventory_hostname|inventory_hostname_short|inventory_dir)\s*\}\}")
_TEMPLATE, _VAULT, NUL = "a template", "a vault value", "a text with a NUL character"
HINTS = {
    _TEMPLATE: "srprov renders no templates: write the value",
    _VAULT: "srprov opens no vault",
    NUL: "no name, address or file has one",
}
"""What is not known of a value -> what to do."""
_OF_A_FOLDER = "inventory_dir"
_MOST = 16_000_000
"""Characters that the hosts have together in what is read of their variables; each value counts as eight more."""
_OF_A_VALUE = 8
_READ_AGAIN = 2
"""How often a character counts of a text that has the host's own name, and is read again for each host."""
_OF_A_WORD = 32
"""As so many characters counts, in such a text, each name and what ends a word: ssh's arguments are taken apart there,
and commands in them."""
_APART = " \t\r\n'\"\\;|&()<>"


class Values:
    """The values of one inventory's variables."""

    def __init__(self) -> None:
        """Begin with nothing read."""
        self._read: dict[Hashable, object] = {}
        self._count = 0

    def once(self, key: Hashable, reader: Callable[[], _T]) -> _T:
        """Return what a reader gives, which is asked once for each key."""
        if key not in self._read:
            self._read[key] = reader()
        return cast(_T, self._read[key])  # of this very reader

    def is_new(self, key: Hashable) -> bool:
        """Return whether a key was never asked for."""
        known = key in self._read
        self._read[key] = None
        return not known

    def count(self, key: str, node: Node, names: Mapping[str, str], findings: Findings) -> None:
        """Count one value of one host, before it is read.

        Raises:
            DefinitionError: All hosts together have more than anybody writes.
        """
        size = self.once(("size", node), lambda: _size(node))
        if put_in := self.names_in(node):
            size += sum(many * len(names[name]) for name, many in put_in.items())
            if not put_in.keys() <= {_OF_A_FOLDER}:
                size = _READ_AGAIN * size + self.once(("apart", node), lambda: _taken_apart(node, put_in))
        self._count += size
        if self._count > _MOST:
            message = f"with '{key}', the hosts have more than {_MOST} characters of variables, all counted together"
            hint = "write it shorter, or for fewer hosts"
            findings.add(node, message, (key,), hint, code=Code.TOO_LARGE)
            raise DefinitionError(findings.problems)

    def names_in(self, node: Node) -> Mapping[str, int]:
        """Return which names stand in a text, and how often."""
        return self.once(("names", node), lambda: Counter(NAMES.findall(node.text)) if isinstance(node, Scalar) else {})

    def of_text(self, kind: str, node: Node, names: Mapping[str, str], reader: Callable[[], _T]) -> _T:
        """Return what is read of a text in which names are put; again only where these are the host's own."""
        put_in = self.names_in(node)
        if put_in.keys() <= {_OF_A_FOLDER}:
            return self.once((kind, node, names[_OF_A_FOLDER] if put_in else ""), reader)
        return reader()


def why_unknown(node: Node) -> str:
    """Return why a value cannot be known, or nothing."""
    if isinstance(node, Seq):
        return next(filter(None, map(why_unknown, node.items)), "")
    if isinstance(node, Map):
        return _VAULT if "__ansible_vault" in node.entries else ""
    if "vault" in node.tag or node.text.startswith("$ANSIBLE_VAULT;"):
        return _VAULT
    if "\0" in node.text:
        return NUL
    bare = NAMES.sub("", node.text)
    return _TEMPLATE if node.tag != "!unsafe" and ("{{" in bare or "{%" in bare) else ""


def check_own(variables: Variables, values: Values, findings: Findings) -> None:
    """Check the variables that begin with srprov_, each value once; a template among them is told where it is read."""
    own = {name: pair for name, pair in variables.items() if name.startswith("srprov_")}
    new = [(name, *pair) for name, pair in own.items() if values.is_new(("own", name, pair[1]))]
    known = {name: (key, value) for name, key, value in new if not why_unknown(value)}
    if known:
        key, _ = next(iter(known.values()))
        entries = {name: value for name, (_, value) in known.items()}
        root = Map(key.source, key.line, key.column, entries, {name: at for name, (at, _) in known.items()})
        schema.check(root, "inventory-vars", findings)


def _taken_apart(node: Node, put_in: Mapping[str, int]) -> int:
    text = node.text if isinstance(node, Scalar) else ""
    return _OF_A_WORD * (sum(put_in.values()) + sum(map(NAMES.sub("", text).count, _APART)))


def _size(node: Node) -> int:
    if isinstance(node, Seq):
        return _OF_A_VALUE + sum(map(_size, node.items))
    if isinstance(node, Map):
        return _OF_A_VALUE * (1 + len(node.entries))
    return _OF_A_VALUE * (1 + node.text.count(",")) + len(node.text)
