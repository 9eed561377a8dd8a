"""CDFs in git repositories: `{git, ref, path}` -> the path of a file here.

Takes nodes, and a function that fetches; gives a path in the folder that it says. Without such a function nothing is
fetched, and what would be needed is noted: `validate` never asks a network.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from srprov.codes import Code
from srprov.definitions import build, paths
from srprov.definitions.values import text
from srprov.yamldoc.allowance import current
from srprov.yamldoc.nodes import Findings, Map, Path

Fetch = Callable[[str, str], str]
"""Address and name of a branch, tag or commit -> absolute path of a folder with its files; raises ValueError."""

NOT_FETCHED = "is fetched by plan and apply, with --allow git"


def located(node: Map, fetch: Fetch | None, findings: Findings, unsupported: Findings, at: Path) -> tuple[str, str]:
    """Return the folder of a repository's files and the path of the CDF in it; empty texts where it is not there."""
    url = build.checked_address(node.entries, findings, at)
    relative = text(node.entries.get("path"))
    if os.path.isabs(relative) or ".." in relative.split("/") or "\0" in relative:
        findings.add(
            node.entries.get("path", node),
            f"'{relative[:80]}' is no path in a repository",
            (*at, "path"),
            code=Code.REPOSITORY,
        )
        return "", ""
    if not url or findings.broken(at):
        return "", ""
    if fetch is None:
        unsupported.add(node, f"the CDF of {url} {NOT_FETCHED}", at, code=Code.REPOSITORY)
        return "", ""
    try:
        folder = fetch(url, text(node.entries.get("ref")))
    except ValueError as error:
        findings.add(node, str(error), at, code=Code.REPOSITORY)
        return "", ""
    if (limits := current.get()) and limits.homes:
        limits.homes.append(folder)
    path = os.path.join(folder, os.path.normpath(relative))
    if not os.path.isfile(path) or not paths.inside(path, folder):
        findings.add(
            node.entries.get("path", node),
            f"there is no CDF '{relative[:80]}' in {url}",
            (*at, "path"),
            code=Code.NO_SUCH_FILE,
        )
        return "", ""
    return folder, path
