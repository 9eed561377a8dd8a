"""Volumes with the name of a file beside their definition: `config.yml:/etc/config.yml` was meant to ship that file.

Takes a document; gives remarks with their places. Looks whether files are there, and opens none. A folder of that name
is no sign of a mistake: results that came home may be in it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq

_MOST = 50


def remarks_on(root: Node | None, kind: str) -> list[Diagnostic]:
    """Return the remarks on an `edf` or a `cdf`."""
    if not isinstance(root, Map):
        return []
    services = root.entries.get("services")
    entries = {"": root} if kind == "cdf" else services.entries if isinstance(services, Map) else {}
    found = [
        one for name, entry in entries.items() if isinstance(entry, Map) for one in _of(entry, name, root.source.file)
    ]
    return found[:_MOST]


def _of(entry: Map, name: str, file: str) -> Iterator[Diagnostic]:
    volumes = entry.entries.get("volumes")
    for index, one in enumerate(volumes.items if isinstance(volumes, Seq) else ()):
        source = one.text.partition(":")[0] if isinstance(one, Scalar) else ""
        if source and "/" not in source and os.path.isfile(os.path.join(os.path.dirname(file), source)):
            path = (*(("services", name) if name else ()), "volumes", index)
            message = f"'{source[:60]}' is a volume of that name, and begins empty"
            yield nodes.problem(one, message, path, f"./{source[:60]} ships the file", code=Code.VOLUME)
