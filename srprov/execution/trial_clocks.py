"""Questions for a robot's time, from which its clock's offset follows. Takes a session; gives samples."""

from __future__ import annotations

import math
import time

from srprov.session import Session
from srprov.trials.clock import Sample
from srprov.untrusted import decimal
from srprov.wire import Query, Reply

CLOCK_ROUNDS = 16
"""At most."""
_IN_VAIN = 5
"""So many in a row that were hardly faster than one before: further ones would not be either."""
_FASTER = 0.9
"""Of the fastest one's time."""
_LONGEST_S = 5.0
"""A robot that answers late is asked less often."""


def samples(session: Session, last: Query) -> tuple[list[Sample], Reply]:
    """Ask one robot for its time, until that gets no faster; return what it said, and its answer to `last`.

    Raises:
        TransportError: It cannot be talked to any more.
    """
    found: list[Sample] = []
    until = time.monotonic() + _LONGEST_S
    fastest, in_vain = math.inf, 0
    for _ in range(CLOCK_ROUNDS):
        asked, begun = time.time(), time.monotonic()
        (reply,) = session.ask([Query(command="date +%s.%N")])
        took = time.monotonic() - begun
        whole, _, fraction = reply.out.strip().partition(".")
        fine = fraction.isdecimal()  # busybox knows no %N
        robot = decimal(f"{whole}.{fraction}" if fine else whole, low=0.0, high=1e11, default=0.0)
        if reply.ok and robot:
            # a step of our own clock in between changes nothing
            found.append(Sample(asked=asked, robot=robot, answered=asked + took, resolution=0.0 if fine else 1.0))
        in_vain = 0 if took < _FASTER * fastest else in_vain + 1
        fastest = min(fastest, took)
        if in_vain == _IN_VAIN or begun > until:
            break
    (more,) = session.ask([last])
    return found, more
