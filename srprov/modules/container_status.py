"""Whether a container has started, is healthy or has completed, by what its engine says when it is inspected."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.resource import Condition
from srprov.untrusted import integer, mapping
from srprov.wire import Reply

_NOT_FOUND = 404


def reached(name: str, condition: str, reply: Reply) -> tuple[bool, str]:
    """Return whether a container has reached a condition, and why it never will, or nothing."""
    body = reply.json()
    if not reply.ok or not isinstance(body, dict):
        return False, f"container {name} is not there" if reply.status == _NOT_FOUND else ""
    state = mapping(body.get("State"))
    status, code = state.get("Status"), integer(state.get("ExitCode"), low=-(2**31), high=2**31, default=-1)
    if condition == Condition.COMPLETED.value:
        failed = status == "exited" and code != 0
        return status == "exited" and code == 0, f"{name} exited with code {code}" if failed else ""
    if condition == Condition.STARTED.value:
        return status == "running", f"{name} exited with code {code}" if status == "exited" else ""
    health = mapping(state.get("Health")).get("Status")
    if status == "exited":
        return False, f"{name} exited with code {code} before it was healthy"
    if health == "unhealthy":
        return False, f"{name} is unhealthy: {_last_check(state)}"
    if status == "running" and (state.get("Health") is None or health == "none"):
        return False, f"{name} has no healthcheck: neither the definitions nor its image say one"
    return health == "healthy", ""


def _last_check(state: Mapping[str, object]) -> str:
    log = mapping(state.get("Health")).get("Log")
    last = mapping(log[-1]) if isinstance(log, list) and log else {}
    return " ".join(str(last.get("Output", "no output")).split())[:200]
