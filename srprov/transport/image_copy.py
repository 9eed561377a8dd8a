"""An image goes from one robot's engine to another's, in pieces through the controller."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

from srprov.errors import TransportError
from srprov.session import Progress
from srprov.transport.image_archive import ForeignImage, only
from srprov.wire import CopyImage, Reply

if TYPE_CHECKING:
    from srprov.transport.engine.client import Engine
    from srprov.transport.options import Peers

_STEP = 16 << 20


def copy_image(
    copy: CopyImage, host: str, engine: Engine, peers: Peers | None, ids: Collection[str], progress: Progress
) -> Reply:
    """Load an image into the engine of `host` while another robot saves it; one piece of it is in memory at a time.

    With `ids`, it has one of them, or is not loaded.

    Raises:
        TransportError: `host` cannot be talked to any more; that of the source is a reply.
    """
    if peers is None:
        return Reply(status=0, ok=False, err=f"no way to {copy.source_host} from here")
    try:
        chunks = peers(copy.source_host).save_image(copy.image, copy.timeout_s)
        return engine.load(_counted(only(chunks, copy.image, ids), copy.image, progress), copy.timeout_s, progress)
    except ForeignImage as error:
        return Reply(status=0, ok=False, err=f"{copy.source_host}: {error}")
    except TransportError as error:
        if error.host == host:
            raise
        return Reply(status=0, ok=False, err=f"{error.host}: {error.message}")


def _counted(chunks: Iterator[bytes], image: str, progress: Progress) -> Iterator[bytes]:
    """Pass chunks on and tell how much went by."""
    total = step = 0
    for chunk in chunks:
        yield chunk
        total += len(chunk)
        if total >= step:
            progress(f"{image}: {total / (1 << 20):.0f} MiB copied")
            step = total + _STEP
    progress(f"{image}: {total / (1 << 20):.1f} MiB copied, loading")
