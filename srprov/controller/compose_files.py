"""What of an experiment's files an export has as text: the EDF, its CDFs, and variables from files. Pure."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Mapping

from srprov.definitions import envfile
from srprov.definitions.model import Definitions
from srprov.definitions.paths import inside, named
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Map


def texts(definitions: Definitions, file: str) -> dict[str, str]:
    """Return the EDF and its CDFs as they were read, by the names that the user would give them."""
    experiment = definitions.experiment
    found = {file: experiment.text}
    for path, one in definitions.containers.items():
        # what git fetched lies in a cache of this machine's
        if path.endswith(".cdf") and inside(path, experiment.folder):
            found[_shown(experiment.folder, file, path)] = one.text
    return found


def _shown(home: str, file: str, path: str) -> str:
    beside = os.path.relpath(path, home)
    return posixpath.normpath(posixpath.join(posixpath.dirname(file), beside))


def env_files(definitions: Definitions, environ: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return what the env_files of each service say; the last one wins."""
    experiment = definitions.experiment
    root = nodes.find(loader.parse(experiment.text, experiment.file) or _empty(), ("services",))
    found: dict[str, dict[str, str]] = {}
    for name, entry in root.entries.items() if isinstance(root, Map) else ():
        given = entry.entries.get("env_file") if isinstance(entry, Map) else None
        items = [given] if isinstance(given, nodes.Scalar) else given.items if isinstance(given, nodes.Seq) else ()
        for item in items:
            if isinstance(item, nodes.Scalar):
                text = experiment.contents[named(item)].decode("utf-8-sig")  # as it was checked
                found.setdefault(name, {}).update(envfile.parse(text, item.text, environ)[0])
    return found


def _empty() -> Map:
    return Map(nodes.Source(""), 1, 1)
