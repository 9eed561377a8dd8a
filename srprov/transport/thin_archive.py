"""An archive that `docker load` takes, written here: list of images, configuration, and only the missing layers.

Whoever loads it has the other layers: engines with a classic store look a layer up before they open its file. A pure
function of what is in it, so that one that was cut off can be continued.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from srprov.layers import MANIFEST, Image, config_name, layer_name, manifest, read_config
from srprov.transport.blobs import Blob
from srprov.transport.image_archive import ForeignImage
from srprov.transport.tar_write import END, tar_blob, tar_file
from srprov.untrusted import json_or_none

_LONGEST_CONFIG = 1 << 20


class ThinArchive(msgspec.Struct, frozen=True):
    """One image under one tag, without the layers that the robot has."""

    image: Image
    tag: str
    config: Blob
    layers: Sequence[Blob]
    """The missing ones."""

    @property
    def size(self) -> int:
        """The archive's bytes."""
        files = [len(manifest(self.image, self.tag)), self.config.content_size, *(one.size for one in self.layers)]
        return sum(512 + size + -size % 512 for size in files) + len(END)

    @property
    def unpacked(self) -> int:
        """The bytes of the layers' contents."""
        return sum(one.content_size for one in self.layers)

    def pieces(self) -> Iterator[bytes]:
        """Yield the archive.

        Raises:
            OSError: The cache's files are gone.
        """
        config = b"".join(self.config.content())
        yield from tar_file(MANIFEST, manifest(self.image, self.tag))
        yield from tar_file(config_name(self.image), config)
        for blob in self.layers:
            yield from tar_blob(layer_name(blob.digest), blob)
        yield END


def check_config(image: Image, config: Blob) -> None:
    """Refuse (ForeignImage) a configuration that names other layers than the robot said that the image has."""
    if config.content_size > _LONGEST_CONFIG:
        raise ForeignImage("its configuration is longer than any sensible one")
    if read_config(image.id, json_or_none(b"".join(config.content()).decode("utf-8", "replace"))) != image:
        raise ForeignImage("its configuration names other layers than the engine says")
