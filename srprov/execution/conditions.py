"""Wait until a container is started, healthy or completed, with a deadline, saying what is awaited."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from urllib.parse import quote as url_quote

from srprov.resource import Condition, Need
from srprov.untrusted import mapping
from srprov.wire import EngineQuery, Session

_FIRST_PAUSE_S = 0.15
_LONGEST_PAUSE_S = 1.0
_NOT_FOUND = 404


def wait_for(
    need: Need, session: Session, *, deadline_s: float, stop: threading.Event, say: Callable[[str], None]
) -> str:
    """Poll until the condition holds; give the empty text then, else why it cannot hold.

    Args:
        need: a container's id and `healthy` or `completed`.
        session: the robot that runs it.
        deadline_s: seconds from now.
        stop: set when the run is interrupted.
        say: called about once a second with what is awaited.

    Raises:
        TransportError: That robot cannot be talked to any more.
    """
    container = need.id.rpartition(":")[2]
    begun = time.monotonic()
    pause, said = _FIRST_PAUSE_S, 0
    while not stop.is_set():
        holds, never = _look(session, container, need.condition)
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


def _look(session: Session, container: str, condition: str) -> tuple[bool, str]:
    """Return (it holds, why it never will)."""
    reply = session.ask([EngineQuery(path=f"/containers/{url_quote(container, safe='')}/json")])[0]
    body = reply.json()
    if not reply.ok or not isinstance(body, dict):
        return False, f"container {container} is not there" if reply.status == _NOT_FOUND else ""
    state = mapping(body.get("State"))
    status, code = state.get("Status"), state.get("ExitCode")
    if condition == Condition.COMPLETED.value:
        failed = status == "exited" and code != 0
        return status == "exited" and code == 0, f"{container} exited with code {code}" if failed else ""
    if condition == Condition.STARTED.value:
        return status == "running", f"{container} exited with code {code}" if status == "exited" else ""
    health = mapping(state.get("Health")).get("Status")
    if status == "exited":
        return False, f"{container} exited with code {code} before it was healthy"
    if health == "unhealthy":
        return False, f"{container} is unhealthy: {_last_check(state)}"
    return health == "healthy", ""


def _last_check(state: Mapping[str, object]) -> str:
    log = mapping(state.get("Health")).get("Log")
    last = mapping(log[-1]) if isinstance(log, list) and log else {}
    return " ".join(str(last.get("Output", "no output")).split())[:200]
