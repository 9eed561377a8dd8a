"""What the secrets of a snapshot are called, and the user's variables that hold them: each name is one container's.

Takes names of services and of their variables; gives names. A robot chooses how its containers and their variables are
called. With a name that another robot's secret has, it would get that one's value.
"""

from __future__ import annotations

import re

_LONGEST = 60
"""Characters of a secret's name."""
_BEGIN = 52
"""Of a name that is taken, so many stay before its number."""


class SecretNames:
    """The names that were given for the services of all robots."""

    def __init__(self) -> None:
        """Have given none."""
        self._taken: set[str] = set()
        self._last: dict[str, int] = {}
        """How a name begins -> the last number that was given for it: a robot may ask for one a thousand times."""

    def give(self, service: str, key: str) -> tuple[str, str]:
        """Return the name of a secret, and of the variable that it comes from, for a variable of a container."""
        secret = re.sub(r"[^A-Za-z0-9_.-]", "-", f"{service}-{key.lower()}")[:_LONGEST].rstrip(".-") or "secret"
        # two lines between the parts, so that they can be told apart
        plain = re.sub(r"[^A-Z0-9_]", "_", f"{service}__{key}".upper())
        return self._fresh(secret, "-"), self._fresh(plain if plain[0].isalpha() else f"S{plain}", "_")

    def _fresh(self, name: str, link: str) -> str:
        begin = name[:_BEGIN]
        found, number = name, self._last.get(begin, 1)
        while found in self._taken:
            number += 1
            found = f"{begin}{link}{number}"
        self._last[begin] = number
        self._taken.add(found)
        return found
