"""What the secrets of a snapshot are called, and the user's variables that hold them: each name is one container's.

Takes names of robots, of services and of their variables; gives names. A robot chooses how its containers and their
variables are called. With a name that another robot's secret has, it would get that one's value. The user may have set
variables for another snapshot, too, so each begins with its robot, by the name that the inventory gives.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Callable

Give = Callable[[str, str], tuple[str, str]]
"""A service and its variable, in; the name of the secret and of the user's variable, out."""
_LONGEST = 60
"""Characters of a secret's name."""
_BEGIN = 52
"""Of a name that is taken, so many stay before its number."""
_SPEAKS_FOR_ITSELF = re.compile("[a-z][a-z0-9]*(-[a-z0-9]+)*")
"""A robot's name of which nothing is lost in a variable's."""


class SecretNames:
    """The names that were given for the services of all robots."""

    def __init__(self) -> None:
        """Have given none."""
        self._taken: set[str] = set()
        self._last: dict[str, int] = {}
        """How a name begins -> the last number that was given for it: a robot may ask for one a thousand times."""

    def of(self, robot: str) -> Give:
        """Return what names the secrets of a robot."""
        return functools.partial(self._give, _beginning(robot))

    def _give(self, robot: str, service: str, key: str) -> tuple[str, str]:
        secret = re.sub(r"[^A-Za-z0-9_.-]", "-", f"{service}-{key.lower()}")[:_LONGEST].rstrip(".-") or "secret"
        # two lines between the parts, so that they can be told apart; that of the robot has no two itself
        variable = f"{robot}__" + re.sub(r"[^A-Z0-9_]", "_", f"{service}__{key}".upper())
        return self._fresh(secret, "-", _BEGIN), self._fresh(variable, "_", len(variable))

    def _fresh(self, name: str, link: str, most: int) -> str:
        begin = name[:most]
        found, number = name, self._last.get(begin, 1)
        while found in self._taken:
            number += 1
            found = f"{begin}{link}{number}"
        self._last[begin] = number
        self._taken.add(found)
        return found


def _beginning(robot: str) -> str:
    """Return how the variables of a robot begin: those of no other robot do, in whatever snapshot."""
    plain = re.sub("[^A-Z0-9]+", "_", robot.upper()).strip("_")
    if _SPEAKS_FOR_ITSELF.fullmatch(robot):
        return plain
    some = plain[:40].rstrip("_") if plain[:1].isalpha() else f"ROBOT_{plain[:40]}".rstrip("_")
    return f"{some}_{hashlib.sha256(robot.encode()).hexdigest()[:12].upper()}"
