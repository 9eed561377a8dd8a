"""An image as an archive that an engine with containerd's store loads: the manifest it was served by, and some layers.

Such an engine pulls no layer whose content it has unpacked already, from another registry perhaps and compressed
otherwise. It then lacks the layer as the manifest names it, and shows and saves no such image. What is loaded it keeps.

Source: OCI Image Layout Specification 1.0; containerd, `client/import.go` (names by annotation).
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator

from srprov.transport.blob import Blob
from srprov.transport.registry_image import MANIFEST, ServedImage, sha256
from srprov.transport.tar_write import END, tar_blob, tar_file


def layers_but(image: ServedImage, without: Collection[str]) -> list[Blob]:
    """Return an image's layers, each once, but for those whose compressed digests are given."""
    return list({one.compressed: one for one in image.layers if one.compressed not in without}.values())


def loaded(image: ServedImage, name: str, layers: Collection[Blob]) -> Iterator[bytes]:
    """Yield the archive.

    Args:
        image: The image.
        name: The name that it gets.
        layers: Those that are in it; the engine has the others.

    Raises:
        OSError: The cache's files are gone.
    """
    entry = {
        "mediaType": MANIFEST,
        "digest": image.digest,
        "size": len(image.manifest),
        "annotations": {"io.containerd.image.name": name},
    }
    yield from tar_file("oci-layout", b'{"imageLayoutVersion":"1.0.0"}')
    yield from tar_file("index.json", json.dumps({"schemaVersion": 2, "manifests": [entry]}).encode())
    for content in (image.manifest, image.config):
        yield from tar_file(_blob(sha256(content)), content)
    for one in layers:
        yield from tar_blob(_blob(one.compressed), one)
    yield END


def _blob(digest: str) -> str:
    return f"blobs/{digest.replace(':', '/')}"
