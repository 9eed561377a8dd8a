"""Wait for another run of the same instance before a plan is made, when the user said how long.

The lock that a run takes later makes sure that no two act at once. But a plan that was made while another run acts is
stale before it begins: what it finds missing is being made.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from srprov.controller.fleet import Fleet
from srprov.errors import LockHeld, visible
from srprov.execution.locks import holders

_LOOK_S = 1.0
_TELL_S = 5.0


def wait_for_other_runs(
    fleet: Fleet, instance: str, seconds: float, tell: Callable[[str], None], robots: Collection[str]
) -> float:
    """Wait at most so many seconds while somebody applies or destroys the instance; return the seconds that are left.

    Only `robots`, which take part, are asked.

    Robots that cannot be asked are not waited for; whether they can be left out is decided later. `tell` is given a
    line every few seconds.

    Raises:
        LockHeld: It went on for longer.
    """
    begun = time.monotonic()
    told = begun - _TELL_S
    while seconds > 0:
        held, _ = holders(robots, fleet.sessions.get, forks=fleet.forks)
        busy = {robot: one for robot, one in held.items() if one and one.purpose.partition(" ")[2] == instance}
        now = time.monotonic()
        left = max(0.0, begun + seconds - now)
        if not busy:
            return left
        robot, one = min(busy.items(), key=lambda pair: pair[0])
        if left <= 0:
            message = f"{robot} is held by {one}, and was not free within {seconds:g} s; nothing was changed"
            raise LockHeld(message, hint="see who holds what with `srprov locks`")
        if now - told >= _TELL_S:
            told = now
            tell(f"waiting up to {left:.0f} s for {visible(robot)}: held by {visible(str(one))}")
        time.sleep(min(_LOOK_S, left))
    return seconds
