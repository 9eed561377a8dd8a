"""The configuration of an image, reached from the id by which its engine knows it.

In a classic store that is the configuration's own hash. In containerd's it is that of a manifest, or of an index of
manifests: each names what is below it by its hash, so the configuration that is reached is the image's.

Source: OCI Image Format Specification, "Image Manifest" and "Image Index".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from srprov.layers import Image, read_config
from srprov.transport.blobs import Blob
from srprov.transport.image_archive import ForeignImage
from srprov.transport.thin_archive import check_config
from srprov.untrusted import json_or_none, mapping, mappings, string

Get = Callable[[str], Blob]
"""Returns a content by its digest; raises ForeignImage where the source has none of it."""
_LONGEST = 1 << 20
_MOST_MANIFESTS = 16
_DIGEST = re.compile("sha256:[0-9a-f]{64}")


def configuration(image: Image, get: Get, *, classic: bool) -> tuple[Image, Blob]:
    """Return an image by its configuration's hash, and that configuration.

    Args:
        image: As its engine tells it.
        get: Gives what is known by a digest.
        classic: The engine knows images by their configuration.

    Raises:
        ForeignImage: None that the id leads to has the layers that the engine tells.
    """
    if classic:
        config = get(image.id)
        check_config(image, config)
        return image, config
    for manifest in _manifests(image.id, get):
        digest = string(mapping(manifest.get("config")).get("digest"))
        if _DIGEST.fullmatch(digest):
            config = get(digest)
            found = read_config(digest, _document(config))
            if found is not None and found.diff_ids == image.diff_ids:
                return found, config
    raise ForeignImage("nothing that its id leads to has the layers that its engine says")


def _manifests(digest: str, get: Get) -> Iterator[Mapping[str, Any]]:
    """Yield the manifest, or those of an index that the source has: it may have the images of one platform alone."""
    top = _document(get(digest))
    below = [string(one.get("digest")) for one in mappings(top.get("manifests"))[:_MOST_MANIFESTS]]
    yield top
    for one in below:
        if _DIGEST.fullmatch(one):
            try:
                yield _document(get(one))
            except ForeignImage:
                continue


def _document(blob: Blob) -> Mapping[str, Any]:
    if blob.content_size > _LONGEST:
        raise ForeignImage("its manifest or configuration is longer than any sensible one")
    return mapping(json_or_none(b"".join(blob.content()).decode("utf-8", "replace")))
