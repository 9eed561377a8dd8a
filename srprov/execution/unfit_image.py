"""Whether an image that came is one that the robot runs, and that does not make its engine's lists too long.

An engine takes an image for another architecture without a word where a registry has that one alone: its containers
would end with `exec format error`. And what an image says is in each list of containers that are made from it: some
hundred thousand ports that it exposes make that longer than is read, and the robot counts as away. Only the image says
what it is, so it is looked at right after it came.
"""

from __future__ import annotations

from srprov.layers import architecture_of, foreign
from srprov.modules.image import ImageParams, untag
from srprov.planning.plan import Step
from srprov.session import Session
from srprov.untrusted import mapping
from srprov.wire import EngineQuery, Reply

_LONGEST = 1 << 20
"""Characters of what an engine says of an image."""
_UNREAD, _NONE = 200, 404


def unfit(step: Step, session: Session) -> Reply | None:
    """Return a failure where the robot does not run the image that a step brought; that loses its name.

    With its name it would pass for the right one from now on. A copy's architecture is compared before it is loaded.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    want = step.want.params if step.want else None
    if not isinstance(want, ImageParams):
        return None
    (reply,) = session.ask([EngineQuery(path=f"/images/{step.name}/json")])
    if reply.status == _NONE:  # the step's own check says so
        return None
    if not reply.ok and reply.status != _UNREAD:
        return reply
    why = _other(want, reply) or _too_much(reply)
    if not why:
        return None
    session.execute(untag(step.name, 200, 404, 409))
    return Reply(status=0, ok=False, err=f"{step.name}: {why}")


def _other(want: ImageParams, reply: Reply) -> str:
    if want.source == "copy" or not want.runs or not reply.ok:
        return ""
    why = foreign(architecture_of(mapping(reply.json()).get("Architecture")), want.runs)
    what = "its base" if want.source == "build" else "its registry"
    return why and f"{why}; perhaps {what} has none for {want.runs[0]}"


def _too_much(reply: Reply) -> str:
    if not reply.ok:
        return f"what it says of itself is not read ({reply.err[:300]})"
    more = len(reply.out) > _LONGEST
    return f"it says more of itself than {_LONGEST >> 20} MiB, by labels or ports that it exposes" if more else ""
