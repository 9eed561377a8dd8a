"""An image as one robot's engine saves it -> an archive, written here, of that image under that tag, and no other.

Takes pieces of a tar and gives pieces of a tar; one piece is in memory at a time. Loading an archive gives the engine
whatever tags stand in it: a robot's own would replace any image of the robot that loads it. So only plain files and
links inside of the archive are passed on, and its list of images is written anew, with the one that is wanted.

Source: Docker Image Specification v1.2, "Combined Image JSON + Filesystem Changeset Format"; moby's `docker save`.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import posixpath
import re
import tarfile
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from srprov.layers import Image, read_config
from srprov.transport.gzip_reader import BeyondLimits
from srprov.transport.image_proof import Proof
from srprov.transport.tar_stream import TarError, TarStream
from srprov.transport.tar_write import tar_file
from srprov.untrusted import json_or_none, mapping, mappings, string

_LIST = "manifest.json"
_OTHER_LISTS = ("repositories", "index.json", "oci-layout")
"""Say the same in other forms; an engine reads them only where there is no manifest.json."""
_LONGEST_LIST = 1 << 20
_LONGEST_DOCUMENT = 1 << 20
_MOST_DOCUMENTS = 64
_DEEPEST = 8
"""Parts of a path; engines write three."""
_DIGEST = re.compile("sha256:[0-9a-f]{64}")


class ForeignImage(Exception):
    """The archive is none, or not the image that is wanted; the text says why."""


class Wanted(NamedTuple):
    """What is known of an image before its archive comes."""

    image: Image
    unproved: Collection[str] = ()
    """Layers that the archive must hold: its engine would take those that it has for whatever is named so."""


def only(
    chunks: Iterator[bytes], image: str, ids: Collection[str] = (), wanted: Wanted | None = None
) -> Iterator[bytes]:
    """Pass on one image of an archive.

    Args:
        chunks: The archive as it comes.
        image: The tag that is wanted.
        ids: The ids of which the image must have one, `sha256:…`; empty where nobody knows any. An id is the hash of
            the configuration, or of a manifest, or an index of manifests, that leads to it.
        wanted: The layers that it must have; None where nobody knows any.

    Raises:
        ForeignImage: The archive is broken, or does not hold that image, or what it has packed goes beyond limits.
    """
    listed: bytes | None = None
    small: dict[str, bytes] = {}
    names: set[str] = set()
    folders: set[str] = set()
    proof = Proof() if wanted and wanted.unproved else None
    try:
        archive = TarStream(chunks)
        for member in archive:
            name = posixpath.normpath(member.name)
            if not member.isdir():
                _check(name, member, names, folders)
            if name == _LIST:
                listed = _small(archive, member)
            elif name not in _OTHER_LISTS and not member.isdir():
                yield from _passed_on(archive, member, name, small, proof)
    except (TarError, UnicodeError) as error:
        raise ForeignImage(f"what comes is no archive of an image: {error}") from error
    except BeyondLimits as error:
        raise ForeignImage(f"what its archive has packed is no layer: {error}") from error
    entry = _entry(listed, image, names - {_LIST, *_OTHER_LISTS})
    if ids and not any(_leads_to(one, small.get(entry["Config"]), small.values()) for one in ids):
        raise ForeignImage(f"it gives another image under {image} than the one that was built")
    if wanted is not None:
        _compare(wanted, small.get(entry["Config"], b""), proof.seen if proof else ())
    yield from tar_file(_LIST, json.dumps([entry]).encode())
    yield b"\0" * 1024


def _check(name: str, member: tarfile.TarInfo, names: set[str], folders: set[str]) -> None:
    """Refuse what no engine writes: paths that leave the archive, files that come twice, lists that are links.

    Nothing lies below a link or a file either: what is compared here under one name would be read under another. Nor
    does a link lead through another one, from where `..` is elsewhere.
    """
    target = posixpath.normpath(posixpath.join(posixpath.dirname(name), member.linkname)) if member.issym() else name
    lists = (_LIST, *_OTHER_LISTS)
    parts = name.split("/")
    down = itertools.dropwhile(lambda one: one in ("", ".", ".."), member.linkname.split("/"))
    leaves = any(path.startswith(("/", "..")) for path in (name, target)) or ".." in down
    if leaves or name == "." or len(parts) > _DEEPEST:
        raise ForeignImage(f"{name!r} is no file that an image has")
    if name in names or (member.issym() and (target in lists or name in lists)):
        raise ForeignImage(f"{name!r} comes twice")
    above = {"/".join(path[:end]) for path in (parts, target.split("/")) for end in range(1, len(path))}
    if name in folders or not names.isdisjoint(above):
        raise ForeignImage(f"{name!r} is a file or a link, or lies below one, where others have a folder")
    names.add(name)
    folders |= above


def _compare(wanted: Wanted, config: bytes, seen: Collection[str]) -> None:
    """Refuse an image of other layers than its engine told, or without one that is to be shown."""
    digest = f"sha256:{hashlib.sha256(config).hexdigest()}"
    found = read_config(digest, json_or_none(config.decode("utf-8", "replace")))
    if found is None or found.diff_ids != wanted.image.diff_ids:
        raise ForeignImage("its archive is of another image than its engine says")
    if lacking := sorted(set(wanted.unproved).difference(seen)):
        raise ForeignImage(f"its archive does not hold {lacking[0]}, which its image names")


def _passed_on(
    archive: TarStream, member: tarfile.TarInfo, name: str, small: dict[str, bytes], proof: Proof | None
) -> Iterator[bytes]:
    """Give a file with a header of our own; keep one that may be a configuration or a manifest."""
    header = tarfile.TarInfo(name)
    header.size, header.linkname = member.size, member.linkname
    header.type = tarfile.SYMTYPE if member.issym() else tarfile.REGTYPE
    yield header.tobuf(tarfile.PAX_FORMAT)
    keep = member.isreg() and member.size <= _LONGEST_DOCUMENT and len(small) < _MOST_DOCUMENTS
    kept = bytearray()
    for piece in proof.of(archive.content()) if proof else archive.content():
        kept += piece if keep else b""
        yield piece
    yield b"\0" * (-member.size % 512)
    if keep:
        small[name] = bytes(kept)


def _leads_to(image_id: str, config: bytes | None, small: Collection[bytes]) -> bool:
    """Return whether an id is a configuration's hash, or that of a manifest or index that names it as one."""
    if config is None:  # a link, or longer than any sensible one: what an engine would read is not known
        return False
    documents = {f"sha256:{hashlib.sha256(one).hexdigest()}": one for one in small}
    wanted, named = f"sha256:{hashlib.sha256(config).hexdigest()}", {image_id}
    for _ in range(2):
        if wanted in named:
            return True
        named = {below for one in named for below in _below(documents.get(one, b""))}
    return wanted in named


def _below(document: bytes) -> set[str]:
    """Return the digests of a manifest's configuration, and of an index's manifests.

    Any other digest that stands in it, as in a label, is a word of whoever wrote the definition, or the base.
    """
    said = mapping(json_or_none(document.decode("utf-8", "replace")))
    every = [string(one.get("digest")) for one in (mapping(said.get("config")), *mappings(said.get("manifests")))]
    return {one for one in every if _DIGEST.fullmatch(one)}


def _small(archive: TarStream, member: tarfile.TarInfo) -> bytes:
    if member.size > _LONGEST_LIST:
        raise ForeignImage(f"{member.name!r} is no list of images")
    return b"".join(archive.content())


def _entry(listed: bytes | None, image: str, names: set[str]) -> dict[str, Any]:
    """Return the one entry of the list that is wanted, with no other tag."""
    every = mappings(json_or_none((listed or b"").decode("utf-8", "replace")))
    found = [one for one in every if image in (tags if isinstance(tags := one.get("RepoTags"), list) else [])]
    if len(found) != 1:
        raise ForeignImage(f"its archive holds {image} {len(found)} times, not once")
    layers = found[0].get("Layers")
    entry = {
        "Config": string(mapping(found[0]).get("Config")),
        "RepoTags": [image],
        "Layers": [string(layer) for layer in layers] if isinstance(layers, list) else [],
    }
    missing = [name for name in (entry["Config"], *entry["Layers"]) if name not in names]
    if missing:
        raise ForeignImage(f"{str(missing[0])[:80]!r} is not in its archive")
    return entry
