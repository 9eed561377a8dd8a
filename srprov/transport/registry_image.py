"""An image as a registry serves it: its manifest is made here, from its configuration and its compressed layers. Pure.

Source: Image Manifest Version 2, Schema 2, which every engine reads.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field

from srprov.layers import Image
from srprov.transport.blobs import Blob

MANIFEST = "application/vnd.docker.distribution.manifest.v2+json"
_CONFIG = "application/vnd.docker.container.image.v1+json"
_LAYER = "application/vnd.docker.image.rootfs.diff.tar.gzip"


@dataclass(frozen=True, kw_only=True, slots=True)
class ServedImage:
    """An image as it is served: a manifest, and what it names."""

    image: Image
    manifest: bytes
    config: bytes
    layers: tuple[Blob, ...]
    name: str = field(default_factory=lambda: f"{secrets.token_hex(16)}/image", repr=False)
    """The repository: 128 random bits, which only the engine that is to pull is told."""

    @property
    def digest(self) -> str:
        """Return the manifest's digest, by which a containerd store also knows the image."""
        return sha256(self.manifest)


def served(image: Image, config: bytes, layers: Sequence[Blob]) -> ServedImage:
    """Return an image to serve, from its configuration, byte for byte, and its layers from the base up."""
    document = {
        "schemaVersion": 2,
        "mediaType": MANIFEST,
        "config": {"mediaType": _CONFIG, "size": len(config), "digest": sha256(config)},
        "layers": [{"mediaType": _LAYER, "size": one.size, "digest": one.compressed} for one in layers],
    }
    manifest = json.dumps(document, indent=3).encode()
    return ServedImage(image=image, manifest=manifest, config=config, layers=tuple(layers))


def sha256(content: bytes) -> str:
    """Return `sha256:…` of bytes."""
    return f"sha256:{hashlib.sha256(content).hexdigest()}"
