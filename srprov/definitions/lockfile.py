"""The lock beside an EDF: what its names led to when it was locked.

Takes a path, or values; gives a `Lock`, or the text of the file. Touches the file, for reading. Others may have
written it: it can say which commit or digest a name stands for, and nothing more.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from types import MappingProxyType

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import hiding, images, paths, schema
from srprov.definitions.own_lines import hide_own
from srprov.definitions.values import text, texts
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.git_address import is_commit
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Findings, Map, Node, Seq

_SHA256 = re.compile(r"[0-9a-f]{64}")
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")
"""Control characters and what ends a line, which neither an address nor a branch has."""
_HEAD = """\
# Written by `srprov lock`; keep it in git. What stands here counts until `srprov lock --update NAME`.
"""


class Packages(msgspec.Struct, frozen=True, kw_only=True):
    """What the build of an image ended with, beyond what its base has; a record that nothing is made of."""

    image: str
    """Its content tag."""
    platform: str
    apt: tuple[str, ...] = ()
    pip: tuple[str, ...] = ()
    npm: tuple[str, ...] = ()
    """Each as a CDF names a package with its version, sorted."""

    @property
    def count(self) -> int:
        """How many they are."""
        return len(self.apt) + len(self.pip) + len(self.npm)


class Lock(msgspec.Struct, frozen=True, kw_only=True):
    """What the names in an experiment stand for."""

    commits: Mapping[tuple[str, str], str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """(address, branch or tag) -> commit"""
    digests: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Full name with tag -> digest"""
    platforms: Mapping[str, tuple[str, ...]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Full name with tag -> platforms that it was there for; a record."""
    files: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Path from the EDF's folder -> sha256"""
    packages: tuple[Packages, ...] = ()
    """Sorted by image and platform; a record."""
    version: str = ""


def lock_path(edf: str) -> str:
    """Return where the lock of an EDF lies: `experiment.lock` for `experiment.edf`."""
    return f"{edf.removesuffix('.edf')}.lock"


def load(path: str) -> Lock | None:
    """Read a lock; None where there is none.

    Raises:
        DefinitionError: With everything that is wrong with it; nothing is shown of a file elsewhere, as by a link.
    """
    if not os.path.lexists(path):
        return None
    if os.path.islink(path):
        hint = "put the lock itself there, or remove the link and write it: srprov lock EDF -i INVENTORY"
        raise DefinitionError(
            [Diagnostic(Location(path), "a lock is no link to another file", hint=hint, code=Code.LOCK_FILE)]
        )
    try:
        return _load(path)
    except DefinitionError as error:
        folder = paths.folder_of(path)
        # whoever names the EDF names its lock, too, and an archive may have given another file that name
        raise DefinitionError(hide_own(hiding.hide_outside(error.problems, folder), "", folder)) from None


def _load(path: str) -> Lock:
    root = _checked(path)
    files = root.entries.get("files")
    locked = [one.entries for one in _maps(root.entries["images"])]
    repositories = [one.entries for one in _maps(root.entries["repositories"])]
    return Lock(
        commits={(text(one["git"]), text(one["ref"])): text(one["commit"]) for one in repositories},
        digests={text(one["name"]): text(one["digest"]) for one in locked},
        platforms={text(one["name"]): texts(one.get("platforms")) for one in locked},
        files={path: text(one) for path, one in files.entries.items()} if isinstance(files, Map) else {},
        packages=tuple(_packages(one.entries) for one in _maps(root.entries.get("packages"))),
        version=text(root.entries["srprov"]),
    )


def _checked(path: str) -> Map:
    root, findings = loader.read(path), Findings()
    if not isinstance(root, Map):
        hint = "remove it, and write it anew: srprov lock EDF -i INVENTORY"
        raise DefinitionError([Diagnostic(Location(path), "a lock is a map", hint=hint, code=Code.LOCK_FILE)])
    files = root.entries.get("files")
    schema.check(_without_files(root, files), "lock", findings)
    for name, sha in files.entries.items() if isinstance(files, Map) else ():
        if not _SHA256.fullmatch(text(sha)):
            findings.add(sha, "is no sha256 in hex", ("files", name), code=Code.LOCK_FILE)
    for index, one in enumerate([] if findings.problems else _maps(root.entries["images"])):
        images.check(one.entries["name"], findings, ("images", index, "name"))
    for index, one in enumerate([] if findings.problems else _maps(root.entries["repositories"])):
        if is_commit(text(ref := one.entries["ref"])):  # else another one would be taken for it
            message = "is a commit already, which stands for nothing else"
            findings.add(ref, message, ("repositories", index, "ref"), code=Code.LOCK_FILE)
        for key in ("git", "ref"):
            if _CONTROL.search(text(one.entries[key])):
                message = f"'{key}' has a control character or an end of a line, which no such name has"
                findings.add(one.entries[key], message, ("repositories", index, key), code=Code.LOCK_FILE)
    if findings.problems:
        raise DefinitionError(findings.problems)
    return root


def _without_files(root: Map, files: Node | None) -> Map:
    """Return the lock for its schema, which takes shorter maps than that of a large experiment's files."""
    empty = Map(root.source, root.line, root.column)
    return replace(root, entries={**root.entries, "files": empty}) if isinstance(files, Map) else root


def _packages(entries: Mapping[str, Node]) -> Packages:
    return Packages(
        image=text(entries["image"]),
        platform=text(entries["platform"]),
        apt=texts(entries.get("apt")),
        pip=texts(entries.get("pip")),
        npm=texts(entries.get("npm")),
    )


def _maps(node: Node | None) -> list[Map]:
    return [one for one in node.items if isinstance(one, Map)] if isinstance(node, Seq) else []


def dump(lock: Lock) -> str:
    """Return the text of a lock: sorted, an entry for each line, so that a change is a line of a diff."""

    def line(**values: object) -> str:
        return "- " + json.dumps(values, ensure_ascii=False)

    digests = [
        line(name=name, digest=digest, platforms=list(lock.platforms.get(name, ())))
        for name, digest in sorted(lock.digests.items())
    ]
    repositories = [line(git=git, ref=ref, commit=commit) for (git, ref), commit in sorted(lock.commits.items())]
    files = [f"  {_quoted(path)}: {sha}" for path, sha in sorted(lock.files.items())]
    parts = (("images", digests, "[]"), ("repositories", repositories, "[]"), ("files", files, "{}"))
    body = "".join("\n".join([f"{key}:", *lines]) + "\n" if lines else f"{key}: {none}\n" for key, lines, none in parts)
    packages = "".join(map(_packages_text, lock.packages))
    return f"{_HEAD}lock: 1\nsrprov: {json.dumps(lock.version)}\n{body}" + (
        f"packages:\n{packages}" if packages else ""
    )


def _quoted(name: str) -> str:
    """Return a file's name, which may be any, as YAML reads it: there more characters end a line than in JSON."""
    return _CONTROL.sub(lambda found: f"\\u{ord(found[0]):04x}", json.dumps(name, ensure_ascii=False))


def _packages_text(one: Packages) -> str:
    lines = [f"- image: {json.dumps(one.image)}", f"  platform: {json.dumps(one.platform)}"]
    for kind, names in (("apt", one.apt), ("pip", one.pip), ("npm", one.npm)):
        lines += [f"  {kind}:"] * bool(names) + [f"  - {json.dumps(name)}" for name in names]
    return "\n".join(lines) + "\n"
