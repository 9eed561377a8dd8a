"""The CDFs that an EDF's services name, on this disk or in git repositories, each read once.

Takes the services' entries; gives containers by service. Touches files, for reading.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import container, paths, remote
from srprov.definitions.container import Container
from srprov.definitions.own_lines import meant
from srprov.definitions.remote import Fetch
from srprov.definitions.values import text
from srprov.errors import DefinitionError
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Path, Scalar


@dataclass(kw_only=True, slots=True)
class Cdfs:
    """What was read."""

    by_path: dict[str, Container] = field(default_factory=dict)
    """Absolute path of a CDF -> what it says."""
    by_service: dict[str, Container | None] = field(default_factory=dict)
    """None for a service with an image, or whose CDF is wrong, not fetched, or not looked at."""
    remote: list[tuple[str, str, str]] = field(default_factory=list)
    """(service, address, branch, tag or commit) of what is in git repositories."""
    left: list[tuple[str, str]] = field(default_factory=list)
    """(service, path) of what a service's CDF names and was not looked at."""


def read(
    entries: Mapping[str, Map], folder: str, environ: Mapping[str, str], fetch: Fetch | None, findings: Findings,
    unsupported: Findings,
) -> Cdfs:  # fmt: skip
    """Read every CDF that a service names; what is not fetched is noted in `unsupported`."""
    found, broken = Cdfs(), set[str]()
    for name in sorted(entries):
        cdf, path = entries[name].entries.get("cdf"), ("services", name, "cdf")
        root, key, shown = "", "", ""
        if isinstance(cdf, Map) and not findings.broken(path):
            found.remote.append((name, text(cdf.entries.get("git")), text(cdf.entries.get("ref"))))
            root, key = remote.located(cdf, fetch, findings, unsupported, path)
            shown = key
        elif isinstance(cdf, Scalar) and cdf.text and not nodes.is_null(cdf):
            key = _beside(cdf, folder, findings, path)
            shown = paths.shown_beside(cdf.source.file, cdf.text)
        if key and key not in found.by_path and key not in broken:
            try:
                found.by_path[key] = _loaded(key, root, folder, environ, shown, fetch)
            except DefinitionError as error:
                findings.extend(error.problems)
                broken.add(key)
        found.by_service[name] = one = found.by_path.get(key)
        found.remote += [(name, *repository) for repository in (one.remote if one else ())]
        found.left += [(name, path) for path in (one.left if one else ())]
    for one in found.by_path.values():
        unsupported.extend(one.unsupported)
    return found


def _loaded(key: str, root: str, folder: str, environ: Mapping[str, str], shown: str, fetch: Fetch | None) -> Container:
    """Read a CDF; `root` is the folder that was fetched for it, if one was."""
    one = container.load(key, folder, environ, shown, fetch)
    return replace(one, fetched=(*one.fetched, root)) if root else one


def _beside(cdf: Scalar, folder: str, findings: Findings, path: Path) -> str:
    """Return the absolute path of a CDF on this disk, or nothing."""
    key = paths.named(cdf)
    if "\0" not in key:
        if paths.is_left(cdf, key, path):
            return ""
        if os.path.isfile(key):
            return key
    what = "is a folder, not a CDF" if os.path.isdir(key.replace("\0", "")) else "does not exist"
    hint = meant(key, folder) or (f"it is looked for at {os.path.relpath(key)}" if "\0" not in key else "")
    findings.add(cdf, f"the CDF '{cdf.text}' {what}", path, hint, code=Code.NO_SUCH_FILE)
    return ""
