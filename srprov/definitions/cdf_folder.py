"""The folder that a CDF which is read by itself may use files of: that of the experiment that it belongs to.

Takes the path of a CDF; gives a folder. Reads the EDFs in the folders above, within limits. An EDF that leads to the
CDF counts, and no other: it may be the user's, and the CDF that of a stranger, in a project that was cloned beside it.
What is wrong in a file is told with its lines, which may be anything.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator

from srprov.definitions import paths
from srprov.errors import DefinitionError
from srprov.yamldoc import loader
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Map, Scalar

_ABOVE = 2
_MOST_EDFS = 64
"""Of one folder."""
_MOST_FILES = 200
"""EDFs, and CDFs that they lead to."""
_MOST_BYTES = 2 << 20
_MOST_VALUES = 30_000


def experiment_folder(cdf: str) -> str:
    """Return a CDF's folder or one of the two above it, the nearest with an EDF that leads to it; or else its own."""
    own = current = os.path.dirname(os.path.abspath(cdf))
    for _ in range(_ABOVE):
        current = os.path.dirname(current)
        if _leads_to(_edfs(current), os.path.realpath(cdf), current):
            return current
    return own


def _edfs(folder: str) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            found = (one.path for one in entries if one.name.endswith(".edf"))
            return sorted(itertools.islice(found, _MOST_EDFS))
    except OSError:
        return []


def _leads_to(edfs: list[str], real: str, folder: str) -> bool:
    """Return whether a service of one of a folder's EDFs has the CDF, or one that extends it, all by its own files."""
    seen, left = set[str](), list(edfs)
    with allowance(_MOST_BYTES, _MOST_VALUES, folder):
        while left and len(seen) < _MOST_FILES:
            path = left.pop()
            if path in seen or paths.is_closed(path):
                continue
            if os.path.realpath(path) == real:
                return True
            seen.add(path)
            left += _named(path)
    return False


def _named(path: str) -> Iterator[str]:
    """Yield the CDFs that an EDF's services name, or that a CDF extends; what cannot be read names none."""
    try:
        root = loader.read(path)
    except DefinitionError:
        return
    if not isinstance(root, Map):
        return
    services = root.entries.get("services")
    entries = services.entries.values() if isinstance(services, Map) else ()
    for node in (root.entries.get("extends"), *(one.entries.get("cdf") for one in entries if isinstance(one, Map))):
        if isinstance(node, Scalar) and node.text and "\0" not in node.text:
            yield paths.named(node)
