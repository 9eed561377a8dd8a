"""Wait until a service is started, healthy or completed, with a deadline, saying what is awaited."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from srprov.modules import RUNNING
from srprov.resource import Need
from srprov.session import Session

_FIRST_PAUSE_S = 0.15
_LONGEST_PAUSE_S = 1.0


def wait_for(
    need: Need, session: Session, *, deadline_s: float, stop: threading.Event, say: Callable[[str], None]
) -> str:
    """Ask again and again until the condition holds; return the empty text then, else why it cannot hold.

    Args:
        need: the id of what runs the service, and `started`, `healthy` or `completed`.
        session: the robot that runs it.
        deadline_s: seconds from now.
        stop: set when the run is interrupted.
        say: called about once a second with what is awaited.

    Raises:
        TransportError: That robot cannot be talked to any more.
    """
    place, _, name = need.id.partition(":")
    module = RUNNING.get(place.rpartition("/")[2])
    if module is None:
        return f"nothing of its kind can be {need.condition}"
    begun = time.monotonic()
    pause, said = _FIRST_PAUSE_S, 0
    while not stop.is_set():
        holds, never = module.reached(name, need.condition, session.ask([module.status_query(name)])[0])
        if holds or never:
            return never
        waited = time.monotonic() - begun
        if waited > deadline_s:
            return f"{need.id} was not {need.condition} within {deadline_s:.0f} s"
        if int(waited) > said:
            said = int(waited)
            say(f"waiting {said} s for {need.id} to be {need.condition}")
        stop.wait(pause)
        pause = min(pause * 1.5, _LONGEST_PAUSE_S)
    return "interrupted"
