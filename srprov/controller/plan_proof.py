"""Which plan files this controller wrote: they alone may use data, and change containers, that it made before.

A plan file says itself which instance and which source it is for. So it carries a proof over all that stands in it,
made with the token of the instance's owner, which lies on this controller only.
"""

from __future__ import annotations

import hashlib
import hmac

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.owners import Owner, owners_of
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.modules.module import canonical
from srprov.modules.secret import names_of
from srprov.planning.planfile import PlanFile, document
from srprov.record.memory import recall


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


def refuse_kept_secrets(saved: PlanFile) -> None:
    """Refuse a plan that was not written here and says of secrets that they are right already.

    Their values are not read for it, so it may say of any that it comes from wherever it likes, also when the user lets
    it change the instance.

    Raises:
        RefusedError: Names the secrets.
    """
    if kept := sorted(names_of(saved.also_wanted)):
        raise RefusedError(
            f"this plan was not written on this controller, and would use what is there of secrets: {', '.join(kept)}",
            hint="plan its EDF here; or apply it by --signers FILE if it is signed",
            code=Code.STRANGE_PLAN,
        )


def check_claim(saved: PlanFile, snapshot: Snapshot) -> None:
    """Refuse a plan that was not written here, as all that it says is only its writer's word.

    Whose an instance is, what its secrets hold, where its services run and who builds its images is believed by later
    runs of the user's own. An instance of which robots have nothing, or say so, may be one that is on others.

    Raises:
        RefusedError: Always; it names where its instance is.
    """
    instance = saved.plan.instance
    there = sorted(
        robot
        for robot, items in snapshot.observed.items()
        if any(one.instance == instance for one in items) or instance in snapshot.records.get(robot, {})
    )
    put = sorted(recall(instance).robots)
    where = (
        f", which is there on {', '.join(there)}" if there else f", put on {', '.join(put)} from here" if put else ""
    )
    raise RefusedError(
        f"this plan was not written on this controller, and would change instance '{instance}'{where}",
        hint="plan its EDF here; or apply it with --signers FILE if it is signed, or --adopt if you believe its writer",
        code=Code.STRANGE_PLAN,
    )


def _digest(saved: PlanFile) -> str:
    """Return the sha256 of all that stands in a plan file; bytes stand in it by theirs."""
    return hashlib.sha256(canonical(document(replace(saved, proof=""))).encode()).hexdigest()
