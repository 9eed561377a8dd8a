"""Checks of what describes a bundle: the RO-Crate hangs together and is true of the files, and the papers follow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import unquote

from srprov import __version__
from srprov.evidence import descriptions
from srprov.evidence.checks_files import Hashed
from srprov.evidence.files import ABOUT, CRATE, NotThere, content, json_of
from srprov.evidence.story import Story
from srprov.untrusted import mapping, mappings, string

_MOST_ENTITIES = 500_000
_NAMES = frozenset({"ro-crate-metadata.json", "./"})


def structure(hashed: Hashed) -> Iterator[str]:
    """Read the crate: what it must have, that references lead somewhere, and that its files are these."""
    document = json_of(hashed.files, CRATE)
    entities = mappings(document.get("@graph"), most=_MOST_ENTITIES)
    by_id = {string(one.get("@id")): one for one in entities}
    if len(by_id) != len(entities):
        yield "two entities have one @id"
    for name in _NAMES - by_id.keys():
        yield f"{CRATE} has no entity {name}"
    root = mapping(by_id.get("./"))
    for key in ("name", "description", "datePublished", "license", "mainEntity"):
        if not root.get(key):
            yield f"the root has no {key}"
    for name, one in by_id.items():
        yield from (
            f"{name[:80]}: {other[:80]} is not in the crate" for other in _references(one)
            if _is_local(other) and other not in by_id
        )  # fmt: skip
        kinds = one.get("@type")
        if kinds == "File" or (isinstance(kinds, list) and "File" in kinds):
            yield from _file(hashed, name, one)


def _references(one: Mapping[str, Any]) -> Iterator[str]:
    for value in one.values():
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, Mapping) and "@id" in each:
                yield string(each["@id"])


def _is_local(name: str) -> bool:
    return not name.startswith(("http://", "https://"))


def _file(hashed: Hashed, name: str, one: Mapping[str, Any]) -> Iterator[str]:
    path = unquote(name)
    if path not in hashed.files.sizes:
        yield f"the crate lists {path[:200]}, which is missing"
    elif one.get("contentSize") != str(hashed.files.sizes[path]) or one.get("sha256") != hashed.sha256(path):
        yield f"the crate says another size or sha256 of {path[:200]}"


def made_by(hashed: Hashed) -> str:
    """Return the version of srprov that made the bundle."""
    return string(json_of(hashed.files, ABOUT).get("srprov"))


def follows(hashed: Hashed, story: Story) -> Iterator[str]:
    """Write what describes the bundle again, and compare it byte by byte."""
    files = hashed.files
    hashes = {
        name: (size, hashed.sha256(name)) for name, size in files.sizes.items() if name not in descriptions.NOT_LISTED
    }
    for name, data in descriptions.written(descriptions.told_of(files, story, hashes)):
        if content(files, name) != data:
            yield f"{name} is not what follows from the run"


def is_ours(hashed: Hashed) -> str:
    """Return why another srprov than this one made it, or nothing."""
    try:
        version = made_by(hashed)
    except NotThere as error:
        return str(error)
    return "" if version == __version__ else f"it was made by srprov {version[:40]}, and this is {__version__}"


def has_our_rules(hashed: Hashed) -> str:
    """Return why it cannot be said how this one describes it, or nothing."""
    if strange := is_ours(hashed):
        return strange
    rules = json_of(hashed.files, ABOUT).get("descriptions")
    if rules != descriptions.RULES:
        return f"it is described by the rules {str(rules)[:40]}, and this srprov has {descriptions.RULES}"
    return ""
