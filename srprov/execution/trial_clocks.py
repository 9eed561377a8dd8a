"""Questions for a robot's time, from which its clock's offset follows. Takes a session; gives samples."""

from __future__ import annotations

import time

from srprov.session import Session
from srprov.trials.clock import Sample
from srprov.untrusted import decimal
from srprov.wire import Query, Reply

CLOCK_ROUNDS = 16
_LONGEST_S = 5.0
"""A robot that answers late is asked less often."""


def samples(session: Session, last: Query) -> tuple[list[Sample], Reply]:
    """Ask one robot for its time, again and again; return what it said, and its answer to `last`.

    Raises:
        TransportError: It cannot be talked to any more.
    """
    found: list[Sample] = []
    more = Reply(status=-1, ok=False)
    until = time.monotonic() + _LONGEST_S
    for left in range(CLOCK_ROUNDS - 1, -1, -1):
        asked, begun = time.time(), time.monotonic()
        is_last = not left or begun > until
        reply, *others = session.ask([Query(command="date +%s.%N"), *([last] if is_last else [])])
        answered = asked + (time.monotonic() - begun)  # a step of our own clock in between changes nothing
        more = others[0] if others else more
        whole, _, fraction = reply.out.strip().partition(".")
        fine = fraction.isdigit()  # busybox knows no %N
        robot = decimal(f"{whole}.{fraction}" if fine else whole, low=0.0, high=1e11, default=0.0)
        if reply.ok and robot:
            found.append(Sample(asked=asked, robot=robot, answered=answered, resolution=0.0 if fine else 1.0))
        if is_last:
            break
    return found, more
