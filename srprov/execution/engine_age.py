"""Since when a robot's Docker Engine runs: what ended before that may have ended with an engine.

An engine that is asked to end stops its containers, with exit codes like any other; nothing of them tells afterwards.
"""

from __future__ import annotations

import re
import time

from srprov.robot_answers import MOST_LINES
from srprov.session import Session
from srprov.untrusted import lines_of
from srprov.wire import Query

_TICKS_A_SECOND = 100
"""What Linux counts in for programs, on every architecture."""
_SAID = re.compile(r"([0-9]{1,12})(?:\.[0-9]{1,9})? ([0-9]{1,15})", re.ASCII)
_ASK = Query(
    command="for one in /proc/[0-9]*; do"
    ' read -r name 2>/dev/null <"$one/comm" && [ "$name" = dockerd ] && read -r line 2>/dev/null <"$one/stat"'
    ' && read -r up _ </proc/uptime && set -- ${line##*) } && echo "$up ${20}"; done; true'
)


def engine_began(session: Session) -> float:
    """Return when the youngest engine on a robot began, in seconds since the epoch by our clock, or up to 2 s later.

    Without one that the robot shows us it is now, so that nothing ended after it began.
    """
    (reply,) = session.ask([_ASK])
    ages = [
        int(match[1]) - int(match[2]) / _TICKS_A_SECOND
        for line in lines_of(reply.out, MOST_LINES)
        if (match := _read(line))
    ]
    return time.time() - max(0.0, min(ages, default=0.0))


def _read(line: str) -> re.Match[str] | None:
    return _SAID.fullmatch(line.strip())
