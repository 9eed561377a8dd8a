"""A new folder that is filled with what a stranger's project holds, so that nothing is written by way of its links.

Takes places, which are relative paths, and contents. Folders and files are made here and are no links; links are made
when everything else is there, so that none leads a file elsewhere.
"""

from __future__ import annotations

import errno
import os
import stat

from srprov import private


class Tree:
    """A folder that this process made, and that nobody else writes to."""

    def __init__(self, top: str) -> None:
        """Begin to fill an empty folder."""
        self.top = top
        self._links: dict[str, str] = {}
        self._made = {""}
        self._files = set[str]()

    @property
    def places(self) -> set[str]:
        """Return where files, folders and links are, or will be; of a folder's folder that may be the inner one's."""
        return {*self._made, *self._files, *self._links}

    def make(self, place: str) -> str:
        """Make a folder and those above it, and return its path.

        Raises:
            OSError: A file has its place, or the place is not below the top.
        """
        path = self.top
        if place in self._made:  # of many files in one deep folder, only the first one looks at all above it
            return f"{path}/{place}".rstrip("/")
        for part in place.split("/") if place else ():
            if part in ("", ".", ".."):
                raise OSError(errno.EINVAL, f"'{place[:80]}' is no place below the folder")
            path = f"{path}/{part}"
            try:
                os.mkdir(path, 0o755)
            except FileExistsError:
                if not stat.S_ISDIR(os.lstat(path).st_mode):
                    raise
        self._made.add(place)
        return path

    def write(self, place: str, content: bytes, mode: int = 0o644) -> None:
        """Write a file; one that has its place already goes.

        Raises:
            OSError: It cannot be written.
        """
        above, _, name = place.rpartition("/")
        path = f"{self.make(above)}/{name}"
        if os.path.lexists(path):
            os.unlink(path)
        self._files.add(place)
        with private.open_new(path) as stream:
            stream.write(content)
            os.fchmod(stream.fileno(), mode)

    def link(self, place: str, target: str) -> None:
        """Have a link made in the end."""
        self._links[place] = target

    def finish(self) -> None:
        """Make the links.

        Raises:
            OSError: Something else has the place of one.
        """
        for place, target in sorted(self._links.items()):
            above, _, name = place.rpartition("/")
            path = f"{self.make(above)}/{name}"
            if os.path.lexists(path):
                words = "it is a link, and something that the import writes has its place"
                raise OSError(errno.EEXIST, words, place)
            os.symlink(target, path)
