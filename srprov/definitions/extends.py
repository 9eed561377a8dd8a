"""A CDF and those that it extends -> one layer.

Takes the path of a CDF, or of a Dockerfile, which is a CDF too; gives the merged layer, and which files that took.
Touches files, for reading, each once. What is in a git repository is fetched where a function for it is given.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from srprov.codes import Code
from srprov.definitions import build, dockerfile, merging, paths, remote, right_kind, schema, unresolved
from srprov.definitions.remote import Fetch
from srprov.definitions.values import text
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Source

_LONGEST_CHAIN = 10
_MERGED_TAGS = merging.RUNTIME_MERGED | merging.BUILD_MERGED | {"requires"}


class ExtendsReader:
    """Reads a CDF and what it extends, each file once; `trail` holds the files on the way here."""

    def __init__(
        self, environ: Mapping[str, str], findings: Findings, unsupported: Findings, fetch: Fetch | None
    ) -> None:
        self.fetch = fetch
        self.remote: list[tuple[str, str]] = []
        self.fetched: list[str] = []
        self.environ = environ
        self.findings = findings
        self.unsupported = unsupported
        self.files: list[str] = []
        self.own: Map | None = None  # the first file's layer, with nothing merged
        self.unknown = False  # something that is extended was not read

    def read(self, path: str, shown: str, trail: tuple[str, ...]) -> Map | None:
        """Return the merged layer, or None when something is wrong (it is in the findings)."""
        own = Findings()
        self.files.append(path)
        try:
            if dockerfile.is_dockerfile(path):
                return _as_layer(path, shown)
            root = right_kind.read(path, "cdf", shown)
        except DefinitionError as error:
            self.findings.extend(error.problems)
            return None
        if not isinstance(root, Map):
            message = "the file is empty" if root is None else f"a CDF is a map, not {nodes.kind(root)}"
            self.findings.extend([Diagnostic(Location(shown), message, hint="begin with cdf: 1", code=Code.WRONG_TYPE)])
            return None
        schema.check(root, "cdf", own)
        schema.check_tags(root, own, _MERGED_TAGS)
        unresolved.check(root, (), own)
        layer = merging.normalise(root, self.environ, own, ()) if not own.problems else root
        self.own = self.own or layer
        parent = self._parent(root, path, shown, trail, own)
        self.findings.extend(own.problems)
        if own.problems or parent is None:
            # what was not read is not known; without it, what is here must still fit together
            return layer if not own.problems and ("extends" not in root.entries or self.unknown) else None
        return _overlay(parent, layer)

    def _parent(self, root: Map, path: str, shown: str, trail: tuple[str, ...], own: Findings) -> Map | None:
        extends = root.entries.get("extends")
        if extends is None or own.broken(("extends",)):
            return None
        target, name = self._target(extends, path, shown, own)
        if not target:
            return None
        if target in (*trail, path):
            steps = [*trail, path]
            circle = [*steps[steps.index(target) :], target]
            message = f"extends itself: {' -> '.join(os.path.basename(step) for step in circle)}"
            own.add(extends, message, ("extends",), code=Code.DEPENDENCY)
            return None
        if len(trail) >= _LONGEST_CHAIN:
            own.add(extends, f"more than {_LONGEST_CHAIN} CDFs extend each other", ("extends",), code=Code.TOO_LARGE)
            return None
        return self.read(target, name, (*trail, path))

    def _target(self, extends: Node, path: str, shown: str, own: Findings) -> tuple[str, str]:
        """Return the path of the CDF that is extended, and its name for messages; empty where there is none."""
        if isinstance(extends, Map):
            self.remote.append((text(extends.entries.get("git")), text(extends.entries.get("ref"))))
            self.unknown = self.unknown or self.fetch is None
            folder, target = remote.located(extends, self.fetch, own, self.unsupported, ("extends",))
            self.fetched += [folder] if folder else []
            return target, target
        if not isinstance(extends, Scalar) or not extends.text:
            return "", ""
        target = os.path.normpath(os.path.join(os.path.dirname(path), extends.text))
        if "\0" not in target and paths.is_left(extends, target, ("extends",)):
            self.unknown = True
            return "", ""
        if "\0" in target or not os.path.isfile(target):
            message, hint = f"there is no CDF '{extends.text}'", f"it is looked for at {os.path.relpath(target)}"
            own.add(extends, message, ("extends",), hint, code=Code.NO_SUCH_FILE)
            return "", ""
        return target, paths.shown_beside(shown, extends.text)


def _as_layer(path: str, shown: str) -> Map:
    """Return a Dockerfile as the CDF that it stands for.

    Raises:
        DefinitionError: It cannot be read.
    """
    source = Source(shown, tuple(loader.read_text(path, shown, dockerfile.MAX_BYTES).split("\n")))
    key = Scalar(source, 1, 1, "dockerfile")
    return Map(source, 1, 1, {"dockerfile": Scalar(source, 1, 1, os.path.basename(path))}, {"dockerfile": key})


def _overlay(parent: Map, child: Map) -> Map:
    """Lay a CDF over the one that it extends; name, version and origin are its own."""
    inherited = {"name", "cdf", "extends"}
    if any(origin in child.entries for origin in build.ORIGINS):
        inherited |= set(build.ORIGINS)
    merged = merging.merge(merging.select(parent, frozenset(parent.entries) - inherited), child)
    assert isinstance(merged, Map)
    return merged
