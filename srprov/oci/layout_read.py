"""An OCI image layout that somebody wrote -> its images, within limits; layers are not opened here.

Takes names with sizes and a way to read small files; gives values, or ValueError with the first thing that is wrong. A
layout is a stranger's: only what srprov writes is read, digests are compared with content, and no name of it is used
but such as follow from a digest.

Source: OCI Image Format Specification 1.1.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from srprov.layers import read_config
from srprov.oci.layout import (
    CONFIG_TYPE,
    ENGINE_IDS,
    INDEX,
    LAYER_TYPE,
    LONGEST,
    MANIFEST_TYPE,
    MARK,
    NAMES,
    VERSION,
    PackedLayer,
    Stored,
    blob,
    documents,
    leading,
    sha256,
    word,
)  # fmt: skip
from srprov.untrusted import mapping, mappings, parse_json, string

MOST_IMAGES = 200
_MOST_LAYERS = 512
_MOST_BYTES = 64 << 20
"""Of all documents; a layer is none."""
_LONGEST_LEADING = 256 << 10
"""Bytes of a document that leads from an engine's id to an image."""
_MOST_LOOKS, _COST = 200_000, 200
"""Digests that are looked up for that, and how many a document counts as that is there, and is looked through."""
_MOST_IDS = 8
"""Of one image: engines have stores of two kinds."""
_DIGEST = re.compile("sha256:[0-9a-f]{64}")
_NAME = re.compile("[A-Za-z0-9][A-Za-z0-9@:/._-]{0,400}")


class Source(msgspec.Struct, frozen=True):
    """The files of a layout."""

    sizes: Mapping[str, int]
    """Path below the layout -> bytes."""
    content: Callable[[str], bytes]
    """Gives a small file."""


@dataclass(slots=True)
class _Documents:
    """The documents of a layout: each is read once, however many images name it, and all of them have a most."""

    source: Source
    read: dict[str, bytes] = field(default_factory=dict)
    size: int = 0
    looks: int = 0

    @property
    def sizes(self) -> Mapping[str, int]:
        """Return path -> bytes, of all files of the layout."""
        return self.source.sizes

    def content(self, path: str) -> bytes:
        """Return a small file.

        Raises:
            ValueError: All that were read are longer than what any layout has.
        """
        if path not in self.read:
            self.size += self.source.sizes[path]
            if self.size > _MOST_BYTES:
                raise ValueError(f"its documents have more than {_MOST_BYTES >> 20} MiB")
            self.read[path] = self.source.content(path)
        return self.read[path]

    def look(self, cost: int) -> None:
        """Count what is looked up on the way from an engine's id to an image.

        Raises:
            ValueError: It is more than any layout needs.
        """
        self.looks += cost
        if self.looks > _MOST_LOOKS:
            raise ValueError("too many documents stand between engines' ids and images")


def read(files: Source) -> tuple[Stored, ...]:
    """Read a layout.

    Raises:
        ValueError: It is not one that srprov wrote.
    """
    source = _Documents(files)
    if mapping(_document(source, MARK)).get("imageLayoutVersion") != VERSION:
        raise ValueError(f"{MARK} says another version than {VERSION}")
    entries = mappings(_document(source, INDEX).get("manifests"), most=MOST_IMAGES + 1)
    if not 0 < len(entries) <= MOST_IMAGES:
        raise ValueError(f"{INDEX} names {len(entries)} images, and {MOST_IMAGES} are the most")
    found = tuple(_image(source, one) for one in entries)
    if len({one.id for one in found}) != len(found):
        raise ValueError(f"{INDEX} names one image twice")
    for path, content in documents(found).items():
        if source.sizes.get(path) != len(content) or source.content(path) != content:
            raise ValueError(f"{path} is not written as srprov writes it")
    named = set(documents(found)) | {blob(layer.digest) for one in found for layer in one.layers}
    if strange := sorted(source.sizes.keys() - named):
        raise ValueError(f"{strange[0][:200]!r} belongs to no image")
    return found


def _document(source: _Documents, path: str) -> Mapping[str, Any]:
    data = _small(source, path)
    try:
        found = parse_json(data.decode("utf-8"))
    except ValueError as error:  # so is what is not UTF-8
        raise ValueError(f"{path}: {error}") from None
    if not isinstance(found, Mapping):
        raise ValueError(f"{path} is no JSON map")
    return found


def _small(source: _Documents, path: str) -> bytes:
    size = source.sizes.get(path)
    if size is None:
        raise ValueError(f"{path} is missing")
    if size > LONGEST:
        raise ValueError(f"{path} is longer than any sensible document")
    return source.content(path)


def _blob(source: _Documents, one: Mapping[str, Any], kind: str) -> str:
    """Return the digest that a descriptor names; its file is there, and has the size."""
    digest, size = string(one.get("digest")), one.get("size")
    if one.get("mediaType") != kind or not _DIGEST.fullmatch(digest):
        raise ValueError(f"a descriptor of {digest[:80]!r} is none of {kind}")
    there = source.sizes.get(blob(digest))
    if there is None:
        raise ValueError(f"{blob(digest)} is missing")
    if type(size) is not int or size != there:
        raise ValueError(f"{blob(digest)} has {there} bytes, and its descriptor says {str(size)[:40]}")
    return digest


def _checked(source: _Documents, digest: str) -> bytes:
    data = _small(source, blob(digest))
    if sha256(data) != digest:
        raise ValueError(f"{blob(digest)} has another content than its name says")
    return data


def _image(source: _Documents, entry: Mapping[str, Any]) -> Stored:
    digest = _blob(source, entry, MANIFEST_TYPE)
    _checked(source, digest)
    manifest = _document(source, blob(digest))
    config_id = _blob(source, mapping(manifest.get("config")), CONFIG_TYPE)
    config = _checked(source, config_id)
    said = _document(source, blob(config_id))
    layers = mappings(manifest.get("layers"), most=_MOST_LAYERS + 1)
    image = read_config(config_id, said)
    ids = image.diff_ids if image else ()
    if not 0 < len(layers) == len(ids):
        raise ValueError(f"the image {config_id} has {len(layers)} layers, and its configuration names {len(ids)}")
    packed = [
        PackedLayer(diff_id, _blob(source, one, LAYER_TYPE), int(one["size"]))
        for diff_id, one in zip(ids, layers, strict=True)
    ]
    if len({(one.diff_id, one.digest) for one in packed}) != len({one.diff_id for one in packed}):
        raise ValueError(f"the image {config_id} has one layer packed twice")
    notes = mapping(entry.get("annotations"))
    names = string(notes.get(NAMES)).split(" ")
    if not all(map(_NAME.fullmatch, names)):
        raise ValueError(f"the image {config_id} has no name that an image can have")
    engine_ids = string(notes.get(ENGINE_IDS)).split(" ")[:_MOST_IDS]
    return Stored(
        id=config_id, engine_ids=tuple(engine_ids), names=tuple(names), config=config, layers=tuple(packed),
        documents=leading(engine_ids, config_id, lambda digest: _document_of(source, digest)),
        architecture=image.architecture if image else "", os=word(said.get("os")),
        variant=word(said.get("variant")),
    )  # fmt: skip


def _document_of(source: _Documents, digest: str) -> bytes | None:
    """Return the document that has a digest; None where there is none."""
    there = _DIGEST.fullmatch(digest) and 0 < source.sizes.get(blob(digest), 0) <= _LONGEST_LEADING
    source.look(_COST if there else 1)
    if not there:
        return None
    return _checked(source, digest)
