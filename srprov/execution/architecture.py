"""Whether an image that was pulled or built is one that the robot runs.

An engine takes an image for another architecture without a word where a registry has that one alone: its containers
would end with `exec format error`. Only the image says what it is for, so it is looked at right after it came.
"""

from __future__ import annotations

from srprov.layers import architecture_of, foreign
from srprov.modules.image import ImageParams
from srprov.planning.plan import Step
from srprov.session import Session
from srprov.untrusted import mapping
from srprov.wire import EngineCall, EngineQuery, Reply


def wrong_architecture(step: Step, session: Session) -> Reply | None:
    """Return a failure where the robot does not run the image that a step brought; that loses its name.

    With its name it would pass for the right one from now on. A copy is compared before it is loaded.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    want = step.want.params if step.want else None
    if not isinstance(want, ImageParams) or want.source == "copy" or not want.runs:
        return None
    (reply,) = session.ask([EngineQuery(path=f"/images/{step.name}/json")])
    why = foreign(architecture_of(mapping(reply.json()).get("Architecture")), want.runs) if reply.ok else ""
    if not why:
        return None
    session.execute(EngineCall(method="DELETE", path=f"/images/{step.name}", accept=(200, 404, 409)))
    what = "its base" if want.source == "build" else "its registry"
    return Reply(status=0, ok=False, err=f"{step.name}: {why}; perhaps {what} has none for {want.runs[0]}")
