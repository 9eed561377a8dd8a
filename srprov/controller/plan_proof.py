"""Which plan files this controller wrote: they alone may use data, and change containers, that it made before.

A plan file says itself which instance and which source it is for. So it carries a proof over all that stands in it,
made with the token of the instance's owner, which lies on this controller only.
"""

from __future__ import annotations

import hashlib
import hmac

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.authority import check_file
from srprov.controller.owners import Owner, owners_of
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.modules.module import canonical
from srprov.names import few
from srprov.planning.planfile import PlanFile, document
from srprov.record.memory import recall

_SHOWN = 8


def proved(saved: PlanFile, owner: Owner | None) -> PlanFile:
    """Return a plan with its owner's proof; one that nobody owns has none."""
    return replace(saved, proof=owner.plan_proof(_digest(saved)) if owner and owner.token else "")


def provers(saved: PlanFile) -> tuple[Owner, ...]:
    """Return the owners, known to this controller, in whose name it wrote a plan; none for one from elsewhere."""
    owners = owners_of(saved.plan.instance, saved.plan.source)
    if not owners or not saved.proof.isascii():
        return ()
    digest = _digest(saved)
    return tuple(one for one in owners if hmac.compare_digest(one.plan_proof(digest), saved.proof))


def check_claim(saved: PlanFile, snapshot: Snapshot, *, adopt: bool) -> None:
    """Refuse a plan that was not written here, as all that it says is only its writer's word.

    Whose an instance is, what its secrets hold, where its services run, who has which address and who builds its images
    is believed by later runs of the user's own. So such a plan changes no instance that is there: of one, it may leave
    out, or give away, what nobody sees in what it shows. `adopt` says that the user believes the writer; then it makes
    a new one, whole.

    Args:
        saved: The plan.
        snapshot: All robots of the inventory.
        adopt: The user believes its writer.

    Raises:
        RefusedError: It names where the instance is.
        UsageError: It says of a robot that answers what may only be said of one that does not.
    """
    instance = saved.plan.instance
    there = _where(instance, snapshot)
    if there or not adopt:
        what = f"would change instance '{instance}'{there}" if there else f"would make instance '{instance}'"
        hint = "apply it with --signers FILE if it is signed"
        hint += "" if there else ", or --adopt if you believe its writer"
    elif saved.limit or saved.targets:
        what = "has only some of the steps that follow from it (--limit, --exclude, --target)"
        hint = "have all of its EDF planned"
    elif elsewhere := sorted({*saved.plan.assignment.values()} - saved.fingerprints.keys()):
        what = f"would have services of a new instance on robots that it knows nothing of: {', '.join(elsewhere)}"
        hint = "have its EDF planned while these answer"
    else:
        _check_answering(saved, snapshot)
        return
    raise RefusedError(
        f"this plan was not written on this controller, and {what}",
        hint=f"plan its EDF here; or {hint}",
        code=Code.STRANGE_PLAN,
    )


def _check_answering(saved: PlanFile, snapshot: Snapshot) -> None:
    """Refuse a file that contradicts itself once it does not say itself who is out of reach.

    Of a robot that is, it may say that services run there of which it wants nothing: they are shown, never made, and
    recorded on all robots.
    """
    plan = saved.plan
    away = {robot: why for robot, why in plan.unreachable.items() if robot not in snapshot.facts}
    if answering := sorted(plan.unreachable.keys() - away.keys()):
        who = f"{few(answering, _SHOWN)} answer{'s' * (len(answering) == 1)}"
        check_file(replace(saved, plan=replace(plan, unreachable=away)), f"this plan, while {who},")


def _where(instance: str, snapshot: Snapshot) -> str:
    there = sorted(
        robot
        for robot, items in snapshot.observed.items()
        if any(one.instance == instance for one in items) or instance in snapshot.records.get(robot, {})
    )
    if there:
        return f", which is there on {', '.join(there)}"
    put = sorted(recall(instance).robots)
    return f", put on {', '.join(put)} from here" if put else ""


def _digest(saved: PlanFile) -> str:
    """Return the sha256 of all that stands in a plan file; bytes stand in it by theirs."""
    return hashlib.sha256(canonical(document(replace(saved, proof=""))).encode()).hexdigest()
