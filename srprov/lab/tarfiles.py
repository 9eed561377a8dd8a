"""Image layers as tar files whose bytes depend on nothing but their content."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Mapping
from pathlib import Path


class Layer:
    """A tar file that is being written: `with Layer(path) as layer: layer.file("x", b"hi")`."""

    def __init__(self, path: Path) -> None:
        """`path` is made, or overwritten."""
        # Closed by __exit__.
        self.tar = tarfile.open(path, "w", format=tarfile.PAX_FORMAT)  # noqa: SIM115
        self.folders: set[str] = set()

    def __enter__(self) -> Layer:
        """Give the layer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Finish the tar file."""
        self.tar.close()

    def folder(self, path: str, mode: int = 0o755) -> None:
        """A folder; those above it are the image's own, or made by the engine."""
        if path not in self.folders:
            self.folders.add(path)
            entry = tarfile.TarInfo(path)
            entry.type, entry.mode = tarfile.DIRTYPE, mode
            self.tar.addfile(entry)

    def file(self, path: str, content: bytes, mode: int = 0o644) -> None:
        """A file of root's."""
        entry = tarfile.TarInfo(path)
        entry.size, entry.mode = len(content), mode
        self.tar.addfile(entry, io.BytesIO(content))

    def files(self, contents: Mapping[str, bytes]) -> None:
        """Several files, in the order of their names."""
        for path in sorted(contents):
            self.file(path, contents[path])

    def link(self, path: str, target: str) -> None:
        """A symbolic link."""
        entry = tarfile.TarInfo(path)
        entry.type, entry.linkname, entry.mode = tarfile.SYMTYPE, target, 0o777
        self.tar.addfile(entry)
