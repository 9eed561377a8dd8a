"""Checks of a bundle's files: that they are those of the manifest, who signed that, and what else says their hashes."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from srprov.controller.bundling import complaint
from srprov.definitions.trialsmodel import folder_of
from srprov.evidence import secrets
from srprov.evidence.files import MANIFEST, SIGNATURE, Files, NotThere, below, content, digest, json_of, sessions
from srprov.evidence.images import LAYOUT
from srprov.evidence.stored_zip import MOST_ENTRIES
from srprov.evidence.verified import Verified
from srprov.oci.layout import BLOBS, LONGEST
from srprov.untrusted import integer, mapping, mappings, string

_LINE = re.compile(r"([0-9a-f]{64})  (.+)\n")
_REST_OF_LINE = 67
"""Bytes of a line beside the name: a hash, two blanks, a line feed."""
_MOST_ABSENT = 1 << 20
"""Bytes of lines of a manifest for files that are not there."""
_LAYERS = LAYOUT + BLOBS
_MOST_SIGNATURE = 64 * 1024


@dataclass(slots=True)
class Hashed:
    """Files with their hashes, each worked out once, and the manifest, which is read once."""

    files: Files
    known: dict[str, str] = field(default_factory=dict)
    _text: bytes | None = None
    _named: dict[str, str] = field(default_factory=dict)

    def sha256(self, name: str) -> str:
        """Return the hash of a file; nothing of one that is not there."""
        if name not in self.known and name in self.files.sizes:
            self.known[name] = digest(self.files, name)
        return self.known.get(name, "")

    def text(self) -> bytes:
        """Return the manifest.

        Raises:
            NotThere: There is none, or it names much that is not there.
        """
        if self._text is None:
            there = sum(len(name.encode()) + _REST_OF_LINE for name in self.files.sizes)
            self._text = content(self.files, MANIFEST, there + _MOST_ABSENT)
        return self._text

    def named(self) -> Mapping[str, str]:
        """Return name -> sha256, as the manifest has it.

        Raises:
            NotThere: There is no manifest, or it is not written as it should be.
        """
        if not self._named:
            self._named = _manifest(self.text())
        return self._named

    def bound(self) -> Hashed:
        """Return the same, once the files are known to be those of the manifest: no others are read from now on."""
        return replace(self, files=Verified(self.files, self.named()))


def _manifest(text: bytes) -> dict[str, str]:
    found: dict[str, str] = {}
    for number, line in enumerate(io.BytesIO(text), start=1):
        match = _LINE.fullmatch(line.decode("utf-8", "replace"))
        if match is None or match[2] in found:
            raise NotThere(f"{MANIFEST}:{number} is not a hash and a name of its own, with an end of the line")
        found[match[2]] = match[1]
    return found


def hashes(hashed: Hashed) -> Iterator[str]:
    """Compare each file with the manifest."""
    for name, sha256 in hashed.named().items():
        now = hashed.sha256(name)
        if now != sha256:
            yield f"{name} is missing" if not now else f"{name} has the sha256 {now}, not {sha256}"


def nothing_else(hashed: Hashed) -> Iterator[str]:
    """Look for files that the manifest does not name."""
    named = hashed.named().keys() | {MANIFEST, SIGNATURE}
    yield from (f"{name} is not in the manifest" for name in hashed.files.sizes if name not in named)


def signature(hashed: Hashed, signers: str) -> Iterator[str]:
    """Check the manifest's signature."""
    signed = content(hashed.files, SIGNATURE, _MOST_SIGNATURE)
    if said := complaint(hashed.text(), signed, signers):
        yield f"it is not signed by anybody in {signers}: {said}"


def results(hashed: Hashed) -> Iterator[str]:
    """Compare results with what their robots said of them when they came home."""
    kept: dict[str, list[str]] = {}
    for name in hashed.files.sizes:
        parts = name.split("/")
        if parts[0] == "trials" and parts[2:3] == ["results"]:
            kept.setdefault(f"trials/{parts[1]}", []).append(name)
    for name in hashed.files.sizes:
        folder, _, end = name.rpartition("/")
        if end == "collected.json" and folder.startswith("trials/") and folder.count("/") == 1:
            yield from _collected(hashed, folder, kept.get(folder, ()))


def _collected(hashed: Hashed, folder: str, kept: Iterable[str]) -> Iterator[str]:
    listed = set[str]()
    for key, some in mapping(json_of(hashed.files, f"{folder}/collected.json").get("results")).items():
        service, _, path = key.partition("/")
        for one in mappings(some, most=MOST_ENTRIES):
            place = _place(hashed.files, f"{folder}/results/{service}", path, string(one.get("name")))
            listed |= {f"{place}/{string(one.get('recovered'))}"} if one.get("recovered") else set()
            if name := string(one.get("name")):
                listed.add(f"{place}/{name}")
                yield from _as_listed(hashed, f"{place}/{name}", one)
    for name in kept:
        if name not in listed:
            yield f"{name} did not come from a robot: {folder}/collected.json does not list it"


def _place(files: Files, home: str, path: str, name: str) -> str:
    """Return the folder that a listed name is relative to: a result's own, of a file the one that it lies in."""
    own = f"{home}/{path}".rstrip("/")
    return own if f"{own}/{name}" in files.sizes else f"{home}{folder_of('/' + path)}".rstrip("/")


def _as_listed(hashed: Hashed, name: str, one: Mapping[str, Any]) -> Iterator[str]:
    size, sha256 = hashed.files.sizes.get(name), hashed.sha256(name)
    if size != integer(one.get("size"), high=1 << 62) or sha256 != one.get("sha256"):
        yield f"{name} is not the file that its robot sent"


def inputs(hashed: Hashed) -> Iterator[str]:
    """Compare the experiment's files with what was recorded when each session began."""
    for home in sessions(hashed.files):
        listed = {f"{home}/inputs/inventory.yml"}
        for one in mappings(json_of(hashed.files, f"{home}/inputs.json").get("files"), most=MOST_ENTRIES):
            if name := string(one.get("file")):
                listed.add(f"{home}/{name}")
                if hashed.sha256(f"{home}/{name}") != one.get("sha256"):
                    yield f"{home}/{name} is not the file that was recorded"
        for name in below(hashed.files, f"{home}/inputs/"):
            if name not in listed:
                yield f"{name} was not recorded when the session began"


def no_secrets(hashed: Hashed) -> Iterator[str]:
    """Look for what looks like a secret; not in packed layers, where nothing looks like one."""
    for name, size in hashed.files.sizes.items():
        if name.startswith(_LAYERS) and size > LONGEST:
            continue
        if why := secrets.found(hashed.files.pieces(name)):
            yield f"{name}: {why}"
