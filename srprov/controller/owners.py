"""Who made a volume: a random token that only this controller has, and what it proves.

A volume's label is a hash of the token with the robot and the volume's name. So it can be checked by who has the token,
and by nobody else: neither a robot, nor a plan or record that was handed on, can make one. The token lies in the user's
folder for state, under the instance and the EDF's real path. It counts for the source that it was kept with: another
repository may lie at that path by now, a stranger's. A bundle that brings another EDF to that path has a token of its
own, and is a source of its own. What `--adopt` took over is listed beside it.

Reads and writes these files only.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from srprov import believed
from srprov.codes import Code
from srprov.definitions.source import source_of
from srprov.errors import UsageError
from srprov.record import default_root
from srprov.resource import Observed
from srprov.untrusted import mapping, parse_json, string, string_map, strings

_LONGEST_FILE = 1 << 20
_DIGITS = 40
_WORDS = ("instance", "edf", "source", "token", "bundle")
_OF_BUNDLE = 32
"""Digits of what is known of a bundle that stand in a source."""


@dataclass(frozen=True, slots=True)
class Had:
    """What a bundle had that was in a place before."""

    token: str = field(repr=False)
    adopted: frozenset[str]
    places: Mapping[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class Owner:
    """Who may use the volumes of an instance."""

    instance: str = ""
    edf: str = ""
    """The EDF's real path."""
    source: str = ""
    """As the last plan named it, for one that comes from a file."""
    token: str = field(default="", repr=False)
    adopted: frozenset[str] = frozenset()
    """What was taken over, as `identity` names it."""
    places: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Volume -> the robot on which it was last made, for when that cannot be reached."""
    bundle: str = ""
    """What is known of the bundle that brought the EDF; empty for one of the user's own."""
    earlier: Mapping[str, Had] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    """Bundles that were there before -> what they had, for when one comes back."""

    def label(self, robot: str, volume: str) -> str:
        """Return the label of a volume that this owner makes."""
        return self._proof("volume", robot, volume)

    def copy_label(self, source: str, created: str, target: str, volume: str) -> str:
        """Return the label of a whole copy, on robot `target`, of what `source` has since `created`."""
        return self._proof("copy", source, created, target, volume)

    def plan_proof(self, digest: str) -> str:
        """Return what proves that this controller wrote a plan file with this digest."""
        return self._proof("plan", digest)

    def knows(self, robot: str, item: Observed) -> bool:
        """Return whether a volume that was found is the owner's."""
        mine = bool(self.token) and hmac.compare_digest(
            _bytes(item.state["owner"]), _bytes(self.label(robot, item.name))
        )
        return mine or identity(robot, item) in self.adopted

    def _proof(self, *words: str) -> str:
        return hmac.new(_bytes(self.token), _bytes("\0".join(words)), hashlib.sha256).hexdigest()[:_DIGITS]


def identity(robot: str, item: Observed) -> str:
    """Return what tells a volume that another made from one that is made later under its name."""
    return f"{robot}/{item.name}/{item.state['owner'] or item.state['created']}"


def owners_folder() -> Path:
    """Return where the tokens lie, beside the runs."""
    return default_root().parent / "owners"


def read_owner(instance: str, edf: str) -> Owner:
    """Return the owner of an instance that is made from an EDF; a new one when this controller knows none."""
    path = os.path.realpath(edf)
    source = source_of(path)
    kept = _read(_place(instance, path, source))
    if kept and (kept.instance, kept.edf) == (instance, path) and _is_of(kept, source):
        return kept
    return Owner(instance=instance, edf=path, token=secrets.token_hex(16))


def _is_of(kept: Owner, source: str) -> bool:
    """Return whether an owner is that of a source; one without a repository is known by the path, whatever the host."""
    before = kept.source.removesuffix(_of_bundle(kept.bundle))
    return before in ("", source) or not any("://" in one for one in (before, source))


def _of_bundle(bundle: str) -> str:
    return f", bundle {bundle[:_OF_BUNDLE]}" if bundle else ""


def with_bundle(source: str, owner: Owner | None) -> str:
    """Return the source of what is made of an EDF: its place, and the bundle that brought it there.

    Another bundle may come to that place, and be a stranger's; it is tried in a lab first, perhaps, or on other robots.
    """
    return source + _of_bundle(owner.bundle if owner else "")


def note_bundle(instance: str, edf: str, bundle: str, folder: str = "") -> None:
    """Write down which bundle brought an EDF: what was made of another one's, by the same path, is not this one's.

    So it is with every path below `folder`, as `note_brought` says.

    Raises:
        UsageError: It cannot be written.
    """
    path = os.path.realpath(edf)
    note_brought(folder or edf, bundle)
    if (instance, path) not in {(one.instance, one.edf) for one in _below(folder or edf)}:
        token, source = secrets.token_hex(16), source_of(path) + _of_bundle(bundle)
        keep(Owner(instance=instance, edf=path, source=source, token=token, bundle=bundle))


def note_brought(folder: str, bundle: str) -> None:
    """Write down of every EDF below a folder, or at a path, of which an owner is known that a bundle brought it.

    A bundle may have further EDFs than the one that is run, and lie there when it is refused: so this comes before its
    first file. One that comes back has what was made of it.

    Raises:
        UsageError: It cannot be written.
    """
    for one in _below(folder):
        if one.bundle != bundle:
            earlier = {**one.earlier, one.bundle: Had(one.token, one.adopted, one.places)}
            had = earlier.pop(bundle, Had(secrets.token_hex(16), frozenset(), {}))
            keep(Owner(
                instance=one.instance, edf=one.edf, source=source_of(one.edf) + _of_bundle(bundle), bundle=bundle,
                token=had.token, adopted=had.adopted, places=had.places, earlier=earlier,
            ))  # fmt: skip


def _below(folder: str) -> list[Owner]:
    """Return the owners of what is at a path, or below it."""
    top = os.path.realpath(folder)
    return [one for one in every_owner() if Path(one.edf).is_relative_to(top) and _is_of(one, source_of(one.edf))]


def owners_of(instance: str, source: str) -> tuple[Owner, ...]:
    """Return all owners that this controller knows for an instance and a source, for a plan from a file."""
    return tuple(owner for owner in every_owner() if (owner.instance, owner.source) == (instance, source))


def every_owner() -> tuple[Owner, ...]:
    """Return all owners that this controller knows."""
    files = sorted(owners_folder().glob("*.json"))
    return tuple(owner for file in files if (owner := _read(file)))


def keep(owner: Owner) -> None:
    """Write the token and what was taken over, before anything is made in the owner's name.

    Raises:
        UsageError: It cannot be written, so a volume would be nobody's.
    """
    file = _place(owner.instance, owner.edf, owner.source.removesuffix(_of_bundle(owner.bundle)))
    if _read(file) == owner:
        return
    words = {name: getattr(owner, name) for name in _WORDS}
    earlier = {bundle: {"token": one.token, **_lists(one)} for bundle, one in owner.earlier.items()}
    text = json.dumps({**words, **_lists(owner), "earlier": earlier}, indent=2) + "\n"
    try:
        believed.write(file, text, _LONGEST_FILE)
    except OSError as error:
        raise UsageError(
            f"cannot write {file}: {error.strerror}",
            hint="it says that the experiment's volumes are yours",
            code=Code.CANNOT_WRITE,
        ) from error


def _lists(one: Owner | Had) -> dict[str, object]:
    return {"adopted": sorted(one.adopted), "places": dict(one.places)}


def _had(read: Mapping[str, object]) -> Had:
    return Had(string(read.get("token")), frozenset(strings(read.get("adopted"))), string_map(read.get("places")))


def _place(instance: str, edf: str, source: str) -> Path:
    """Return the file of an owner: where that of another source is there already, one beside it."""
    first = _file(instance, edf)
    there = _read(first)
    beside = source if "://" in source else ""  # a plain folder's is the same when the host is called otherwise
    return first if there is None or _is_of(there, source) else _file(instance, edf, beside)


def _file(*words: str) -> Path:
    name = hashlib.sha256(_bytes("\0".join(words))).hexdigest()
    return owners_folder() / f"{name[:32]}.json"


def _read(file: Path) -> Owner | None:
    """Return what a file says; one that is not there, or says nothing, costs one `--adopt`."""
    try:
        read = mapping(parse_json(believed.read(file, _LONGEST_FILE).decode(), max_characters=_LONGEST_FILE))
    except (OSError, ValueError):
        return None
    words = {key: string(read.get(key)) for key in _WORDS}
    if not words["token"]:
        return None
    some = {bundle: _had(mapping(one)) for bundle, one in mapping(read.get("earlier")).items()}
    had, earlier = _had(read), {bundle: one for bundle, one in some.items() if one.token}
    return Owner(**words, adopted=had.adopted, places=had.places, earlier=earlier)


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")
