"""How a run behaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from srprov.session import Pulse
from srprov.wire import EngineCall

if TYPE_CHECKING:
    from srprov.execution.probing import OverlayProbe
    from srprov.planning.plan import Plan

MOST_AT_ONCE = 128
"""Robots that are waited for at the same time where all are, such as for their locks: each takes a thread."""
STOP_TIMEOUT_S = 60.0


class RunOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a run behaves."""

    forks: int = 64
    wait_timeout_s: float = 300.0
    """For a container to become healthy or to complete."""
    stop_timeout_s: float = STOP_TIMEOUT_S
    """For a container to stop by itself, whatever its own grace is; then it is killed."""
    triggers: frozenset[str] = frozenset()
    """Robots on which ONBUILD instructions of the images that a build starts from may run."""
    patience_s: float = 10.0
    """After an interrupt, for running steps to end; then their connections are closed."""
    settle_s: float = 2.0
    """A service must still be running this long after its start."""
    max_fail: int | None = None
    """No further step begins when steps failed on more robots than this; None: never."""
    tolerate: frozenset[str] = frozenset()
    """Robots that may be out of reach."""
    verb: str = "apply"
    """What holders of a lock are told to be doing, with the instance."""
    run: str = ""
    """The run's id in the lock and in the robots' audit logs; empty: a fresh one, and nothing is logged."""
    lock_wait_s: float = 0.0
    """How long to wait for a robot that somebody else holds."""
    pulse: Pulse = msgspec.field(default_factory=Pulse)
    makers: frozenset[str] | None = None
    """Who made the instance, as far as the plan knew, its own source too: with anybody else's on a robot nothing is
    done. None: nobody looks."""
    probing: OverlayProbe | None = None
    """What to try when something on the overlay changed; None: nothing."""


def hurried(plan: Plan, stop_timeout_s: float) -> list[str]:
    """Return a line for each service that is killed before the end of the time that it asks for to stop."""
    return [
        f"{step.service} on {step.host} asks for {call.stop_grace_s:.0f} s to stop and is killed after "
        f"{stop_timeout_s:.0f} s; --stop-timeout gives it longer"
        for step in plan.steps
        for call in step.commands
        if isinstance(call, EngineCall) and (call.stop_grace_s or 0.0) > stop_timeout_s
    ]
