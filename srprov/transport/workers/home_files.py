"""Files of the machine where srprov runs, for a process of a site: each comes over once, and is kept there.

Takes the link to that machine; gives files of this one, which were compared with their hashes.
"""

from __future__ import annotations

import errno
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from srprov import datasets
from srprov.transport.blobs import Blob, Blobs, WrongBlob
from srprov.transport.turns import Turns
from srprov.transport.workers.far import FarItems
from srprov.transport.workers.link import ROOT
from srprov.wire import SendData

if TYPE_CHECKING:
    from srprov.transport.workers.link import Link

_GIVER = "srprov"
"""In the place of an address: the content came from the machine where srprov runs."""


class LinkedFiles:
    """What this process asks the other one for."""

    def __init__(self, link: Link, blobs: Blobs, turns: Turns) -> None:
        """Take the way there, the cache of layers, and who gives turns."""
        self._link, self._blobs, self._turns = link, blobs, turns

    def layer(self, digest: str) -> Blob | None:
        """Return a content of an image from the cache there; None where it has none. Whoever asks has its turn.

        Raises:
            OSError: It cannot be written here.
        """
        handle = self._link.call(ROOT, "layer", digest)
        if handle is None:
            return None
        try:
            return self._blobs.add(digest, FarItems(self._link, handle))
        except WrongBlob as error:
            raise OSError(errno.EIO, str(error)) from error

    def data_set(self, command: SendData) -> Path:
        """Return a data set that the machine there has or downloads; one that is kept here is not sent again.

        Raises:
            ValueError: There is none.
            WrongData: What came is another content.
            OSError: It cannot be read there, or written here.
        """
        with self._turns.turn(command.sha256):
            pieces = iter(FarItems(self._link, self._link.call(ROOT, "data_set", command)))
            first = next(pieces, b"")  # raises when this run has no right to it, whatever is kept here
            if kept := datasets.find(command.sha256, _GIVER):
                return kept
            return datasets.keep(command.sha256, chain((first,), pieces), _GIVER)
