"""Images of a bundle into this machine's cache of layers, from which robots get them.

Takes contents by their digests; writes the cache. Each is compared with its digest when it is written: what is not
what it is called is not kept.
"""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterable, Iterator

import msgspec

from srprov import private
from srprov.codes import Code
from srprov.errors import UsageError
from srprov.transport.blobs import Blobs, WrongBlob

_MARGIN = 512 << 20


class Content(msgspec.Struct, frozen=True):
    """A layer or a configuration of an image in a bundle."""

    digest: str
    """Of its content."""
    size: int
    """Bytes of it as it is stored."""
    pieces: Callable[[], Iterator[bytes]]
    packed: bool
    """By gzip."""


def keep(contents: Iterable[Content], say: Callable[[str], None]) -> None:
    """Write what the cache does not have.

    Args:
        contents: Of images, each once.
        say: Is told how far it is.

    Raises:
        UsageError: One is not what its digest says, or there is no room for all.
    """
    blobs = Blobs()
    try:
        missing = [one for one in contents if blobs.get(one.digest, lambda: True) is None]
        private.make_folder(blobs.folder)
        need, free = sum(one.size for one in missing) + _MARGIN, shutil.disk_usage(blobs.folder).free
        if missing and free < need:
            why = f"there is no room: {need >> 20} MiB are needed, {free >> 20} MiB are free"
            raise OSError(errno.ENOSPC, why, str(blobs.folder))
        for number, one in enumerate(missing, start=1):
            say(f"images of the bundle: {number} of {len(missing)} parts, {one.size >> 20} MiB")
            with blobs.turn(one.digest):
                (blobs.add if one.packed else blobs.add_content)(one.digest, one.pieces())
    except OSError as error:
        hint = "make room there, or take images by their names: --no-bundled-images"
        raise UsageError(
            f"{error.filename or blobs.folder}: {error.strerror or error}", hint=hint, code=Code.CANNOT_WRITE
        ) from error
    except WrongBlob as error:
        raise UsageError(
            f"an image of the bundle is not what it says: {error}", hint="srprov verify it", code=Code.BUNDLE_FALSE
        ) from error
