"""Which robots gave a content that the cache of layers keeps: whoever names one by its digest need not have it.

An image's configuration names its layers, and a robot that lies builds one that names those of another experiment. From
the cache only what the robot itself gave once counts as its own: the one with that host key, as every laboratory may
have a robot1. Kept as `givers.json` beside the cache's folder, which may be a link of the user's; what is lost from it
costs one more read. Safe for several threads.
"""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path

from srprov import believed
from srprov.untrusted import json_or_none, mapping, strings

_MOST_DIGESTS = 5_000
_MOST_GIVERS = 20
"""Of one content."""
_MOST_BYTES = 8 << 20


class Givers:
    """Who gave what; nothing is read before it is asked for."""

    def __init__(self, folder: Path) -> None:
        """Take the cache's folder."""
        self._path = folder.parent / "givers.json"
        self._lock = threading.Lock()
        self._known: dict[str, list[str]] = {}

    def gave(self, digest: str, robot: str) -> bool:
        """Return whether a robot, by its session's `identity`, gave this content."""
        with self._lock:
            if robot not in self._known.get(digest, ()):
                self._known = self._read()  # another process may have noted it
            return robot in self._known.get(digest, ())

    def note(self, digest: str, robot: str) -> None:
        """Keep that a robot gave this content."""
        with self._lock:
            known = self._read()
            robots = [one for one in known.pop(digest, ()) if one != robot]
            known[digest] = [*robots, robot][-_MOST_GIVERS:]
            self._known = dict(list(known.items())[-_MOST_DIGESTS:])
            with contextlib.suppress(OSError):  # it is read from the robot once more
                believed.write(self._path, json.dumps(self._known), _MOST_BYTES)

    def _read(self) -> dict[str, list[str]]:
        try:
            text = believed.read(self._path, _MOST_BYTES).decode("utf-8", "replace")
        except OSError:
            return {}
        return {digest: strings(robots) for digest, robots in mapping(json_or_none(text)).items()}
