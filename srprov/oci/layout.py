"""The documents of an OCI image layout as srprov writes it, with the list that `docker load` takes beside it.

Takes images whose layers are packed; gives path -> text. Equal images give equal documents. Pure.

Source: OCI Image Format Specification 1.1, "Image Layout", "Image Index", "Image Manifest"; Docker Image Specification
v1.2.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from srprov.image_reference import bundled_name
from srprov.untrusted import string

MARK, INDEX, DOCKER = "oci-layout", "index.json", "manifest.json"
BLOBS = "blobs/sha256/"
_OCI = "application/vnd.oci.image"
MANIFEST_TYPE, INDEX_TYPE, CONFIG_TYPE, LAYER_TYPE = (
    f"{_OCI}.manifest.v1+json", f"{_OCI}.index.v1+json", f"{_OCI}.config.v1+json", f"{_OCI}.layer.v1.tar+gzip",
)  # fmt: skip
REF_NAME = "org.opencontainers.image.ref.name"
ENGINE_IDS, NAMES = "srprov.image.ids", "srprov.image.names"
VERSION = "1.0.0"
LONGEST = 4 << 20
"""Bytes of a document."""
_MOST_DOCUMENTS = 16
"""Of one image, that lead to its configuration."""
_MOST_NAMED = 1000
"""Digests in one of them: an index has some for each platform, a manifest one for each layer."""
_WORD = re.compile("[a-z0-9_-]{0,20}")
_NAMED = re.compile(rb"sha256:[0-9a-f]{64}")


class PackedLayer(msgspec.Struct, frozen=True):
    """One layer of an image."""

    diff_id: str
    """sha256 of its tar."""
    digest: str
    """sha256 of what is stored: the same, packed."""
    size: int
    """Bytes of that."""


class Stored(msgspec.Struct, frozen=True, kw_only=True):
    """One image of a layout."""

    id: str
    """The digest of its configuration."""
    engine_ids: tuple[str, ...]
    """By which engines know it: the same, or in a containerd store that of a manifest or an index."""
    names: tuple[str, ...]
    """As experiments name it."""
    config: bytes
    layers: tuple[PackedLayer, ...]
    documents: tuple[bytes, ...] = ()
    """What leads from the engines' ids to the configuration, where these are not the same."""
    architecture: str = ""
    os: str = "linux"
    variant: str = ""

    @property
    def manifest(self) -> bytes:
        """Its manifest."""
        layers = [{"mediaType": LAYER_TYPE, "digest": one.digest, "size": one.size} for one in self.layers]
        config = {"mediaType": CONFIG_TYPE, "digest": self.id, "size": len(self.config)}
        return as_json({"schemaVersion": 2, "mediaType": MANIFEST_TYPE, "config": config, "layers": layers})

    @property
    def platform(self) -> dict[str, str]:
        """What it runs on."""
        said = {"architecture": self.architecture, "os": self.os, "variant": self.variant}
        return {key: value for key, value in said.items() if value}


def word(said: object) -> str:
    """Return a word of a configuration, such as its system; empty for what is none."""
    return found if _WORD.fullmatch(found := string(said)) else ""


def as_json(document: Mapping[str, Any] | Sequence[Any]) -> bytes:
    """Return a document as it is written: always the same bytes."""
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode("utf-8", "replace")


def sha256(data: bytes) -> str:
    """Return `sha256:…`."""
    return f"sha256:{hashlib.sha256(data).hexdigest()}"


def blob(digest: str) -> str:
    """Return where a layout keeps what has a digest."""
    return BLOBS + digest.removeprefix("sha256:")


def documents(images: Sequence[Stored]) -> dict[str, bytes]:
    """Return path -> content of all that is not a layer; images in the order of their configurations' digests."""
    images = sorted(images, key=lambda one: one.id)
    found: dict[str, bytes] = {}
    entries, listed = [], []
    for one in images:
        manifest = one.manifest
        found |= {blob(one.id): one.config, blob(sha256(manifest)): manifest}
        found |= {blob(sha256(data)): data for data in one.documents}
        entries.append(_index_entry(one, manifest))
        layers = [blob(layer.digest) for layer in one.layers]
        listed.append({"Config": blob(one.id), "RepoTags": [bundled_name(one.id)], "Layers": layers})
    found[MARK] = as_json({"imageLayoutVersion": VERSION})
    found[INDEX] = as_json({"schemaVersion": 2, "mediaType": INDEX_TYPE, "manifests": entries})
    found[DOCKER] = as_json(listed)
    return {path: found[path] for path in sorted(found)}


def _index_entry(one: Stored, manifest: bytes) -> dict[str, Any]:
    # one that says what the image is: whoever loads a layout would have the names in it moved to what is there
    name = bundled_name(one.id)
    return {
        "mediaType": MANIFEST_TYPE, "digest": sha256(manifest), "size": len(manifest), "platform": one.platform,
        "annotations": {REF_NAME: name, ENGINE_IDS: " ".join(one.engine_ids), NAMES: " ".join(one.names)},
    }  # fmt: skip


def leading(engine_ids: Sequence[str], config_id: str, get: Callable[[str], bytes | None]) -> tuple[bytes, ...]:
    """Return the documents that lead from engines' ids to a configuration; none from that itself.

    Args:
        engine_ids: By which engines know the image.
        config_id: The digest of its configuration.
        get: Gives the document that has a digest; None where there is none.

    Raises:
        ValueError: None lead there from one of them.
    """
    found: dict[str, bytes] = {}
    for one in dict.fromkeys(engine_ids):
        if one != config_id:
            found |= _leading(one, config_id, get)
    return tuple(found[digest] for digest in sorted(found))


def _leading(engine_id: str, config_id: str, get: Callable[[str], bytes | None]) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    wanted = deque([engine_id])
    while wanted and len(found) < _MOST_DOCUMENTS:
        digest = wanted.popleft()
        data = None if digest in found else get(digest)
        if data is None:
            continue
        found[digest] = data
        named = [one[0].decode() for one in itertools.islice(_NAMED.finditer(data), _MOST_NAMED)]
        if config_id in named:
            return found
        wanted += named
    raise ValueError(f"nothing leads from the id {engine_id[:80]!r} to the configuration {config_id}")
