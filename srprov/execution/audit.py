"""One line in the log of every robot that a run changed: when, which run, who, what, and how many steps.

Takes the robots of a run and what came of its steps; appends to AUDIT_LOG over the sessions that are open, with the
lock still held. Best effort: a robot that cannot be written to is a reason in words, never a failure of the run. The
log stays when the instance is destroyed. The time is the robot's own, in UTC.
"""

from __future__ import annotations

import concurrent.futures
import re
from collections.abc import Iterable, Mapping

import msgspec

from srprov.errors import TransportError
from srprov.execution.options import MOST_AT_ONCE
from srprov.execution.outcome import Outcome, StepResult
from srprov.execution.robot import RobotExecutor
from srprov.failure import why
from srprov.session import Session
from srprov.wire import Run, quote

AUDIT_LOG = "/var/log/srprov.log"
_TIMEOUT_S = 10.0
_TOUCHED = (Outcome.CHANGED, Outcome.FAILED, Outcome.UNREACHABLE)


class AuditEntry(msgspec.Struct, frozen=True, kw_only=True):
    """What every line of one run has in common."""

    run: str
    owner: str
    """user@host of the controller"""
    verb: str
    instance: str

    def line(self, changed: int, failed: int) -> str:
        """Return the line without its time: words of `name=value`, none of which holds a space."""
        words = {"run": self.run, "by": self.owner, "verb": self.verb, "instance": self.instance}
        shown = [f"{name}={re.sub(r'[^!-~]', '_', value)}" for name, value in words.items()]
        return " ".join([*shown, f"changed={changed}", f"failed={failed}"])


def audit(entry: AuditEntry, robots: Mapping[str, RobotExecutor], results: Iterable[StepResult]) -> dict[str, str]:
    """Write the lines, on all robots at once.

    Args:
        entry: what the lines say.
        robots: those that can still be talked to.
        results: what came of all steps; one that took no time never sent a command.

    Returns:
        Robot -> why it has no line, for robots that were changed.
    """
    counts: dict[str, list[int]] = {}
    for result in results:
        if result.duration_s > 0 and result.outcome in _TOUCHED:
            count = counts.setdefault(result.step.host, [0, 0])
            count[result.outcome is not Outcome.CHANGED] += 1
    missing = {host: "it cannot be reached any more" for host in sorted(counts) if host not in robots}
    here = sorted(counts.keys() & robots.keys())
    if not here:
        return missing
    with concurrent.futures.ThreadPoolExecutor(min(len(here), MOST_AT_ONCE)) as pool:
        lines = {host: entry.line(*counts[host]) for host in here}
        replies = pool.map(lambda host: _append(robots[host].session, lines[host]), here)
    return missing | {host: why for host, why in zip(here, replies, strict=True) if why}


def _append(session: Session, line: str) -> str:
    script = f'umask 027; printf "%s %s\\n" "$(date -u +%Y-%m-%dT%H:%M:%SZ)" {quote(line)} >> {AUDIT_LOG}'
    try:
        reply = session.execute(Run(script=script, timeout_s=_TIMEOUT_S))
    except TransportError as error:
        return error.message
    return "" if reply.ok else why(reply)
