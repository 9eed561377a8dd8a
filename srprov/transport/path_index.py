"""Folders in order: which of them hold a path, and which lie below it, without going through all of them. Pure."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator


class Folders:
    """Whole paths, each once."""

    def __init__(self, paths: Iterable[str] = ()) -> None:
        """Put them in order."""
        self._every = {_key(one) for one in paths}
        self._keys = sorted(self._every)

    def holding(self, path: str) -> Iterator[str]:
        """Yield those that are a path or hold it, the innermost first."""
        key = _key(path)
        for slash in reversed([*re.finditer("/", key)]):
            if key[: slash.end()] in self._every:
                yield key[: slash.start()] or "/"

    def below(self, path: str) -> str:
        """Return one that lies below a path, or nothing."""
        key = _key(path)
        at = bisect_right(self._keys, key)
        return self._keys[at][:-1] if at < len(self._keys) and self._keys[at].startswith(key) else ""


def _key(path: str) -> str:
    return f"{path.rstrip('/')}/"
