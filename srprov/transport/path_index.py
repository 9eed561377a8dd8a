"""Folders in order: which of them hold a path, and which lie below it, without going through all of them. Pure."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator


class Folders:
    """Whole paths, each once."""

    def __init__(self, paths: Iterable[str] = ()) -> None:
        """Put them in order."""
        self._keys = sorted({_key(one) for one in paths})
        self._above: list[int] = []
        """Of each, the innermost other one that holds it, or -1."""
        way: list[int] = []
        for number, key in enumerate(self._keys):
            while way and not key.startswith(self._keys[way[-1]]):
                way.pop()
            self._above.append(way[-1] if way else -1)
            way.append(number)

    def holding(self, path: str) -> Iterator[str]:
        """Yield those that are a path or hold it, the innermost first."""
        key = _key(path)
        # whatever stands between a folder and what it holds is held by it, too
        at = bisect_right(self._keys, key) - 1
        while at >= 0:
            if key.startswith(self._keys[at]):
                yield self._keys[at][:-1] or "/"
            at = self._above[at]

    def below(self, path: str) -> str:
        """Return one that lies below a path, or nothing."""
        key = _key(path)
        at = bisect_right(self._keys, key)
        return self._keys[at][:-1] if at < len(self._keys) and self._keys[at].startswith(key) else ""


def _key(path: str) -> str:
    return f"{path.rstrip('/')}/"
