"""A bundle that was verified, read again: what is read later is what was verified then, or it is not read.

A bundle may lie where others can write, and be another one each time that it is opened, or each time that a part of it
is read. So whoever goes on with a bundle that was checked gets its files by way of this.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import msgspec

from srprov.evidence.files import MANIFEST, SIGNATURE, Files, NotThere, opened


class Verified(msgspec.Struct, frozen=True):
    """Files whose hashes are known: what is read of one has its hash, or the reader is told that it has not."""

    files: Files
    hashes: Mapping[str, str]
    """Name -> sha256 of each; the manifest and its signature, in which nobody reads any more, have none."""

    @property
    def sizes(self) -> Mapping[str, int]:
        """Return name -> bytes, in name order."""
        return self.files.sizes

    def pieces(self, name: str) -> Iterator[bytes]:
        """Return a file's content in pieces; NotThere behind the last one where it is another."""
        made = hashlib.sha256()
        for piece in self.files.pieces(name):
            made.update(piece)
            yield piece
        if self.hashes.get(name, made.hexdigest()) != made.hexdigest():
            raise NotThere(f"{name} is not what it was when it was verified")


class Bundle(msgspec.Struct, frozen=True):
    """A bundle that was verified."""

    path: str
    hashes: Mapping[str, str]
    """As `Verified` has them."""
    signed: bool = False
    """Somebody signed it whom the user named: nobody else's definitions may be run in its place."""

    @property
    def digest(self) -> str:
        """Return what it is known by: another one has another file, or one with another content."""
        lines = "".join(f"{sha256}  {name}\n" for name, sha256 in sorted(self.hashes.items()))
        return hashlib.sha256(lines.encode()).hexdigest()


@contextmanager
def reopened(bundle: Bundle) -> Iterator[Verified]:
    """Open a bundle that was verified, to read just what was verified.

    Raises:
        UsageError: It cannot be read.
        NotThere: It has other files now.
    """
    with opened(bundle.path) as found:
        if found.sizes.keys() - {MANIFEST, SIGNATURE} != bundle.hashes.keys():
            raise NotThere("it has other files than when it was verified")
        yield Verified(found, bundle.hashes)
