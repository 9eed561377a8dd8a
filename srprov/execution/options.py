"""How a run behaves."""

from __future__ import annotations

from dataclasses import dataclass, field

from srprov.session import Pulse


@dataclass(frozen=True, kw_only=True, slots=True)
class RunOptions:
    """How a run behaves."""

    forks: int = 64
    wait_timeout_s: float = 300.0
    """For a container to become healthy or to complete."""
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
    pulse: Pulse = field(default_factory=Pulse)
