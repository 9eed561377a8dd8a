"""`${…}` where a value is taken as it is written: Compose puts values in there, an EDF or CDF never does.

Takes the root of a document and the fields of each service; adds to `Findings`. Pure. Commands, scripts and health
checks are a shell's, which puts values in itself.
"""

from __future__ import annotations

from collections.abc import Iterator

from srprov.codes import Code
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

HINT = "no variables are substituted here: write the value out"


def check(entry: Map, path: Path, findings: Findings) -> None:
    """Add a problem for each `${` in the ports, devices and sources of volumes of a service or a CDF."""
    for key in ("ports", "devices", "volumes"):
        for place, node in _values(entry.entries.get(key), (*path, key)):
            at = node.text.find("${")
            if at >= 0 and not findings.broken(place) and (key != "volumes" or at < _end_of_source(node.text)):
                shown = node.text[at : at + 60].partition("}")[0] + "}"
                findings.add(node, f"'{shown}' would stay as it is", place, HINT, code=Code.UNRESOLVED)


def _values(node: Node | None, path: Path) -> Iterator[tuple[Path, Scalar]]:
    """Yield the texts of a field; of an entry that is a map, all but where in the container it is."""
    if isinstance(node, Scalar):
        yield path, node
    elif isinstance(node, Seq):
        for index, item in enumerate(node.items):
            yield from _values(item, (*path, index))
    elif isinstance(node, Map):
        for key, item in node.entries.items():
            if key != "target":
                yield from _values(item, (*path, key))


def _end_of_source(text: str) -> int:
    """Return where the source of `source:target` ends; colons of `${NAME:-default}` do not count."""
    depth = 0
    for at, letter in enumerate(text):
        depth += (text[at - 1 : at + 1] == "${") - (letter == "}" and depth > 0)
        if letter == ":" and not depth:
            return at
    return len(text)
