"""What is allowed in an EDF or CDF and may not mean what its writer expects: dollars, for people who come from Compose.

Takes a document; gives remarks with their places. Pure. Compose puts variables into every value and reads `$$` as `$`;
here each value is taken as it is written. Commands, scripts and health checks may be a shell's, which puts variables
in itself, so that `${…}` is right there.
"""

from __future__ import annotations

from collections.abc import Iterator

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Map, Node, Path, Scalar, Seq

_MOST = 50
_SHELLS = ("command", "entrypoint", "healthcheck")
_OPEN = "would stay as it is: no variables are substituted here"
_TWICE = "'$$' stays two dollars here; Compose reads it as one"


def remarks_on(root: Node | None, kind: str) -> list[Diagnostic]:
    """Return the remarks on an `edf` or a `cdf`, at most so many as somebody reads."""
    if not isinstance(root, Map):
        return []
    services = root.entries.get("services")
    entries: dict[Path, Node] = {(): root} if kind == "cdf" else {}
    if kind == "edf" and isinstance(services, Map):
        entries = {("services", name): entry for name, entry in services.entries.items()}
    found = [one for path, entry in entries.items() if isinstance(entry, Map) for one in _of_service(entry, path)]
    return list(dict.fromkeys(found))[:_MOST]


def _of_service(entry: Map, path: Path) -> Iterator[Diagnostic]:
    for place, one in _texts(entry.entries.get("environment"), (*path, "environment")):
        at = one.text.find("${")
        if at >= 0:
            shown = one.text[at : at + 60].partition("}")[0] + "}"
            yield nodes.problem(one, f"'{shown}' {_OPEN}", place, "write the value out", code=Code.UNRESOLVED)
    for key in ("environment", *_SHELLS):
        for place, one in _texts(entry.entries.get(key), (*path, key)):
            if "$$" in one.text:
                hint = "write one '$'; two are right where a shell wants its own number"
                yield nodes.problem(one, _TWICE, place, hint, code=Code.UNRESOLVED)


def _texts(node: Node | None, path: Path) -> Iterator[tuple[Path, Scalar]]:
    if isinstance(node, Scalar):
        yield path, node
    elif isinstance(node, Seq):
        for index, item in enumerate(node.items):
            yield from _texts(item, (*path, index))
    elif isinstance(node, Map):
        for key, item in node.entries.items():
            yield from _texts(item, (*path, key))
