"""Whether the names of a run's trials are free when its robots are locked: each trial removes what has them."""

from __future__ import annotations

import threading
from collections.abc import Mapping

from srprov.codes import Code
from srprov.controller.ownership import shown_maker
from srprov.controller.trial_plan import TrialPlan
from srprov.errors import RefusedError, TransportError
from srprov.execution.others import refuse_made_since
from srprov.execution.trial_at_once import at_once
from srprov.modules.container import ContainerModule
from srprov.resource import Observed
from srprov.session import Session
from srprov.untrusted import text


def refuse_others(plan: TrialPlan, sessions: Mapping[str, Session]) -> None:
    """Refuse to begin where somebody else made such a container since the plan was shown: nothing was locked then.

    Raises:
        RefusedError: Names it.
        TransportError: A robot cannot be talked to any more.
    """
    assert plan.base.snapshot is not None
    observed = plan.base.snapshot.observed
    shown = {(host, one.name): one.state.get("source") for host, items in observed.items() for one in items}
    names = {(one.host, one.name) for one in plan.services}
    hosts = sorted({host for host, _ in names})
    found = at_once(hosts, lambda host: _there(sessions[host]), threading.Event())
    for host, items in sorted(found.items()):
        for one in items:
            maker = one.state["source"]
            if (host, one.name) in names and maker not in (plan.base.plan.source, shown.get((host, one.name))):
                raise RefusedError(
                    f"the robot changed since the plan was made: {one.name} on {host} is there, "
                    f"made from {shown_maker(maker)}",
                    hint="run it again, under another name with --instance NAME",
                    code=Code.OWNER,
                )
    # a container of another name would still be inside of what is somebody else's by now
    refuse_made_since(plan.base.plan.instance, plan.base.makers or {plan.base.plan.source}, sessions, hosts)


def _there(session: Session) -> tuple[Observed, ...]:
    """Return the containers on a robot; a list that cannot be read is no empty one."""
    module = ContainerModule()
    replies = session.ask(module.queries())
    if not replies[0].ok:
        why = text(replies[0].err) or f"status {replies[0].status}"
        raise TransportError(session.host, f"its containers cannot be listed: {why}", code=Code.ENGINE)
    return module.parse(replies)
