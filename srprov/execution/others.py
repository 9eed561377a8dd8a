"""Whether somebody else made the instance of a plan since the plan was made: then nothing of it is done.

A question may stand for an hour, and nothing is locked meanwhile. What comes under an instance's name joins it: its
network, its hosts files, the record that says whose it is. So it is not enough that each step finds what its plan saw:
a container that nobody else made would still be inside. Whoever asks holds the locks of these robots.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Mapping, Sequence

from srprov.codes import Code
from srprov.errors import RefusedError, TransportError, visible
from srprov.execution.trial_at_once import at_once
from srprov.modules import MODULES
from srprov.modules.module import STATE_ROOT
from srprov.modules.observe import observe_queries, parse_observed
from srprov.planning.plan import Plan
from srprov.robot_answers import answers_of
from srprov.session import Session
from srprov.untrusted import json_or_none, lines_of, mapping, string
from srprov.wire import AnyQuery, Query, Reply, quote

_KINDS = ("container", "network", "volume")
"""Which say by a label who made them."""
_LONGEST = 300
"""Characters of what a robot says of who made an instance."""


def refuse_others(plan: Plan, makers: Collection[str] | None, sessions: Mapping[str, Session]) -> None:
    """Refuse to begin a plan where somebody else made its instance since.

    Args:
        plan: What is to be done; images are nobody's, and robots that get no more are not asked.
        makers: As `refuse_made_since` has it; None: nobody looks.
        sessions: Connections to the robots, which are locked.

    Raises:
        RefusedError: So it is.
    """
    if makers is not None:
        robots = {step.host for step in plan.steps if not MODULES[step.module].shared}
        refuse_made_since(plan.instance, makers, sessions, robots)


def refuse_made_since(
    instance: str, makers: Collection[str], sessions: Mapping[str, Session], robots: Collection[str]
) -> None:
    """Refuse to go on where a robot says of an instance that another experiment made it than the plan knew of.

    Args:
        instance: The plan's.
        makers: Sources: the plan's own, and those that robots told of when it was made.
        sessions: Connections to the robots.
        robots: Those that are asked, all at once. What one says that is lost meanwhile is not known.

    Raises:
        RefusedError: Names the robot, and who made it; or the robot does not tell.
    """
    queries = (*observe_queries(_KINDS), _record(instance))
    hosts = sorted(sessions.keys() & {*robots})
    if not hosts:
        return
    found = at_once(hosts, lambda host: _told(instance, host, sessions[host], queries), threading.Event())
    for host, said in sorted(found.items()):
        if others := sorted(said - {*makers, ""}):
            maker = visible(others[0][:_LONGEST])
            raise RefusedError(
                f"{host} changed since the plan was made: instance '{instance}' is there, made from {maker}; "
                "nothing was done",
                hint="plan it again, under another name with --instance NAME",
                code=Code.OWNER,
            )


def _told(instance: str, host: str, session: Session, queries: Sequence[AnyQuery]) -> frozenset[str]:
    try:
        replies = session.ask(queries)
        with answers_of(host):
            makers = frozenset(_makers(instance, replies))
    except TransportError:  # its steps say so
        return frozenset()
    if odd := next((one for one in replies if not one.ok and one.status), None):  # where no engine is, nothing runs
        why = visible(odd.err[:_LONGEST]) or f"status {odd.status}"
        raise RefusedError(f"{host} does not say who made what is there: {why}; nothing was done", code=Code.ENGINE)
    return makers


def _makers(instance: str, replies: Sequence[Reply]) -> Iterator[str]:
    for item in parse_observed(replies[:-1], _KINDS):
        if item.instance == instance:
            yield string(item.state.get("source"))
    for line in lines_of(replies[-1].out, 1):
        yield string(mapping(json_or_none(f"{{{line}}}")).get("source"))


def _record(instance: str) -> Query:
    """Ask who made it by the record that the robot keeps, of which the rest names all robots and may be long."""
    path = quote(f"{STATE_ROOT}/{instance}/placement.json")
    return Query(command=rf"""grep -oE '"source":"([^"\\]|\\.)*"' {path} 2>/dev/null; :""")
