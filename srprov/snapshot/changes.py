"""What was changed in a container's own files since it was made. Pure; what its robot says of it is untrusted."""

from __future__ import annotations

import posixpath

from srprov.sandbox import sandboxed
from srprov.untrusted import integer, lines_of
from srprov.wire import Query

_MOST = 10_000
_MOST_OF_NAMES = 1 << 20
"""Paths that are looked at, and bytes of them: a container names its files as it likes."""


def changes_query(upper: str) -> Query:
    """Ask how many bytes of its own files a container has below a folder of the robot, and what is there."""
    find = f"find . -xdev -mindepth 1 -printf '/%P\\n' | head -c {_MOST_OF_NAMES}"
    return Query(command=sandboxed(upper, f"du -s -x --apparent-size -B 1 . && {find}"), timeout_s=60)


def changes(said: str) -> tuple[int, list[str]]:
    """Return bytes, and paths without the folders above them, which are told too."""
    size, _, listed = said.partition("\n")
    paths = lines_of(listed, _MOST)
    folders = {posixpath.dirname(path) for path in paths}
    return integer(size.partition("\t")[0], high=1 << 53), sorted({*paths} - folders - {""})
