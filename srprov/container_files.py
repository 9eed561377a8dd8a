"""Files of a container as its engine sees them, whether it runs or not: the protocol that sessions implement.

Takes nothing and touches nothing. Behind it is `transport/engine/archive.py`, or `transport/container_folders.py` where
an engine could be led elsewhere. With it stands which engines cannot be.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Protocol

import msgspec

MENDED = (29, 5, 1)


def is_mended(version: str) -> bool:
    """Return whether an engine of that version mounts nothing by name while it is asked for a container's files.

    One whose version is not told does. What distributions call those that they mend themselves is not known.
    """
    numbers = re.match(r"([0-9]{1,4})\.([0-9]{1,4})\.([0-9]{1,4})", version, re.ASCII)
    return numbers is not None and tuple(map(int, numbers.groups())) >= MENDED


class InContainer(msgspec.Struct, frozen=True, kw_only=True):
    """What is at a path of a container."""

    is_folder: bool = False
    is_file: bool = False
    size: int = 0
    """Bytes of a file."""
    link: str = ""
    """Where a symbolic link leads in the container, as a whole path; empty: it is none."""


class ContainerFiles(Protocol):
    """A way to the files of one robot's containers. Paths are whole ones of the container."""

    def path_in(self, container: str, path: str) -> InContainer | None:
        """Say what is at a path, without following a link there; None for nothing.

        Raises:
            TransportError: The engine refuses, or it or the robot cannot be talked to.
            RefusedError: Its engine alone could tell, and may be led elsewhere; so for the others.
        """

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a file or folder as a tar, whose names all begin with one part, or none where a mount is copied.

        Raises:
            TransportError: The engine refuses, or it or the robot is gone.
        """

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder of the container; a folder takes no file's place, and no file a folder's.

        What was unpacked before a failure stays.

        Raises:
            UsageError: The tar is none, or has something in the place of something else.
            TransportError: The engine refuses, or it or the robot is gone.
        """
