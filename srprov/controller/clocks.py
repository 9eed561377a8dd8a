"""A robot's clock, measured for a check. Takes a session, asks up to sixteen times; gives values."""

from __future__ import annotations

from srprov import time_sync
from srprov.execution.trial_clocks import samples
from srprov.facts.preconditions import Clock
from srprov.session import Session
from srprov.trials.clock import offset
from srprov.wire import Query


def measure_clock(session: Session) -> Clock:
    """Return how far a robot's clock is from ours, with the bound of the error, and what keeps it.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    said, reply = samples(session, Query(command=time_sync.SCRIPT))
    found = offset(said)
    return Clock(
        offset_s=found.offset_s if found else None,
        error_s=found.error_s if found else 0.0,
        kept_by=time_sync.parse(reply.out),
    )
