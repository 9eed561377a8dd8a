"""Files of a container as its engine sees them, whether it runs or not: the protocol that sessions implement.

Takes nothing and touches nothing. `transport/engine/archive.py` is behind it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import msgspec


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
        """

    def copy_out(self, container: str, path: str) -> Iterator[bytes]:
        """Yield a file or folder as a tar, whose names begin with the last part of the path.

        Raises:
            TransportError: The engine refuses, or it or the robot is gone.
        """

    def copy_into(self, container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder of the container; a folder takes no file's place, and no file a folder's.

        What was unpacked before a failure stays.

        Raises:
            TransportError: The engine refuses, or it or the robot is gone.
        """
