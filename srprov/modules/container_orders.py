"""What a user's `stop`, `start` and `restart` do to a container, and whether it came true. Pure."""

from __future__ import annotations

from srprov.modules.container_commands import start, stop
from srprov.resource import Observed, State
from srprov.wire import Command, EngineCall

_ALIVE = ("running", "paused", "restarting")


def ordered_commands(found: Observed, verb: str) -> tuple[Command, ...]:
    """Return the commands of `stop`, `start` or `restart`; none when it is so already."""
    state, grace = found.state["state"], float(found.state.get("stop_grace", 10))
    if verb == "stop":
        return (stop(found.name, grace),) if state in _ALIVE else ()
    if verb == "restart" and state in _ALIVE:
        return (stop(found.name, grace), start(found.name))
    if state == "running":
        return ()
    return (
        EngineCall(method="POST", path=f"/containers/{found.name}/unpause") if state == "paused" else start(found.name),
    )


def not_ordered(found: State, verb: str) -> str:
    """Return why an order that was done has not come true, or nothing; a job may have ended with 0 by then."""
    state, code = found["state"], found["exit_code"]
    if verb == "stop":
        return f"it is {state}" if state in _ALIVE else ""
    if state == "running" or (state == "exited" and code == 0 and found.get("job")):
        return ""
    return f"exited with code {code}" if state == "exited" else f"state is {state or 'unknown'}"
