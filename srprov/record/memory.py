"""What this machine remembers between runs: placement records that it gave, images that it had built, files of secrets.

Takes and gives values; a small JSON file per instance, and one for images and for secrets, below the user's folder for
state. A file that is missing or broken is as no memory at all: then robots are believed less, not more.
"""

from __future__ import annotations

import hashlib
import json
import os
import urllib.parse
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec

from srprov import believed, own_records, secret_files
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.record.folder import default_root
from srprov.untrusted import mapping, parse_json, string, string_map, strings

_LONGEST = 4 << 20
_MOST_KEPT = 2000
_LONGEST_NAME = 4096
"""Bytes; no file has a longer one."""


class Memory(msgspec.Struct, frozen=True, kw_only=True):
    """What runs of this machine wrote of one instance."""

    robots: frozenset[str] = frozenset()
    """That were given a record."""
    proofs: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> what it proved to be: another inventory may give its name to another one. A file of an older srprov does
    not tell it, and what it tells counts for nobody who answers."""
    records: tuple[str, ...] = ()
    """`digest` of each record that robots may have, the newest last: more than one while a run is not at its end."""


def digest(record: Mapping[str, Any]) -> str:
    """Return what a record is known by."""
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def recall(instance: str) -> Memory:
    """Return what is remembered of an instance."""
    try:
        kept = mapping(parse_json(believed.read(_place(instance), _LONGEST).decode()))
    except (OSError, ValueError):
        return Memory()
    robots, records = frozenset(strings(kept.get("robots"))), tuple(strings(kept.get("records")))
    return Memory(robots=robots, records=records, proofs=string_map(kept.get("proofs")))


def remember(instance: str, memory: Memory) -> str:
    """Keep the memory of an instance, an empty one: forget it; return why that is not possible, or nothing."""
    place = _place(instance)
    if memory.robots:
        document = {"robots": sorted(memory.robots), "records": memory.records, "proofs": dict(memory.proofs)}
        return "" if memory == recall(instance) else _write(place, document)
    try:
        if os.path.lexists(place):
            believed.check(place.parent)  # by way of somebody else's link it would be another file of the user's
            place.unlink()
    except OSError as error:
        return f"{place}: {error.strerror or error}"
    return ""


def built_for(tag: str, arch: str) -> str:
    """Return under what the ids of images are remembered that were built of a content tag for an architecture.

    Each architecture has builders of its own, and a robot may say that it is of any: what it builds for itself as the
    only one of it is no image of the others.
    """
    return f"{tag} {arch}"


def known_images() -> dict[str, frozenset[str]]:
    """Return what `built_for` says -> `ID WHO` of images that a run of this machine had built so, by who built them.

    WHO is the robot's `identity`; a file of an older srprov does not tell it.
    """
    return _sets(_images())


def note_images(built: Mapping[str, Collection[str]]) -> str:
    """Remember `ID WHO` of images that were built, by what `built_for` says; return why not, or nothing."""
    return _add(_images(), built)


def who_ran() -> dict[str, frozenset[str]]:
    """Return an image of a run of trials -> the robots that had it there; see `controller.trial_images`."""
    return _sets(_ran())


def note_ran(had: Mapping[str, Collection[str]]) -> str:
    """Remember who had images of a run; return why that is not possible, or nothing."""
    return _add(_ran(), had)


def note_inventory(text: str) -> str:
    """Remember that a record of this machine has an inventory with this text; return why not, or nothing."""
    return _add(own_records.place(), {own_records.digest(text.encode()): ()})


def note_secret_files(paths: Collection[str]) -> None:
    """Remember that some files are secrets', never what is in them.

    None that is there is forgotten for others: whoever calls thousands of files so would have the first one shipped.

    Raises:
        UsageError: They are more than the list can hold, or it cannot be written.
    """
    before, place = secret_files.listed(), secret_files.place()
    paths = {one for one in paths if len(os.fsencode(one)) <= _LONGEST_NAME}
    if paths <= set(before):
        return
    every = [*(one for one in before if one not in paths), *sorted(paths)]
    forgotten = {*[one for one in every if not os.path.lexists(one)][:-_MOST_KEPT]}
    document: dict[str, list[str]] = {one: [] for one in every if one not in forgotten}
    if len(json.dumps(document)) > secret_files.LONGEST:
        hint = f"remove from {place} those that are no secrets' any more"
        raise UsageError("too many files are known as secrets'", hint=hint, code=Code.CANNOT_WRITE)
    if reason := _write(place, document):
        text = f"which files are secrets' cannot be kept: {reason}"
        raise UsageError(text, hint="let XDG_STATE_HOME name a folder of yours", code=Code.CANNOT_WRITE)


def _sets(place: Path) -> dict[str, frozenset[str]]:
    try:
        kept = mapping(parse_json(believed.read(place, _LONGEST).decode()))
    except (OSError, ValueError):
        return {}
    return {string(key): frozenset(map(string, some)) for key, some in kept.items() if isinstance(some, list)}


def _add(place: Path, more: Mapping[str, Collection[str]]) -> str:
    known = _sets(place)
    news = {key: known.get(key, frozenset()) | set(some) for key, some in more.items()}
    if all(known.get(key) == some for key, some in news.items()):
        return ""
    newest = [*((key, some) for key, some in known.items() if key not in news), *news.items()][-_MOST_KEPT:]
    return _write(place, {key: sorted(some) for key, some in newest})


def _ran() -> Path:
    return default_root().parent / "ran.json"


def _images() -> Path:
    return default_root().parent / "images.json"


def _write(place: Path, document: object) -> str:
    """Replace a file; return why that is not possible, or nothing."""
    try:
        believed.write(place, json.dumps(document), _LONGEST)
    except OSError as error:
        return f"{error.filename or place}: {error.strerror or error}"
    return ""


def _place(instance: str) -> Path:
    name = urllib.parse.quote(instance, safe="") or "-"
    return default_root().parent / "placements" / f"{name[:200]}.json"
