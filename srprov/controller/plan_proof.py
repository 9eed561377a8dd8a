"""Which plan files this controller wrote: they alone may use data, and change containers, that it made before.

A plan file says itself which instance and which source it is for. So it carries a proof over all that stands in it,
made with the token of the instance's owner, which lies on this controller only.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Collection, Sequence

from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.overlay_claim import of_others
from srprov.controller.owners import Owner, owners_of
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.modules.module import canonical
from srprov.modules.secret import names_of
from srprov.planning.plan import Step
from srprov.planning.planfile import PlanFile, document
from srprov.record.memory import recall
from srprov.resource import Resource


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


def had_it(saved: PlanFile) -> Collection[str]:
    """Return the robots on which this machine's last run of a plan's instance put something."""
    return recall(saved.plan.instance).robots


def check_claim(
    saved: PlanFile, wants: Sequence[Resource], steps: Sequence[Step], snapshot: Snapshot, *, adopt: bool
) -> None:  # fmt: skip
    """Refuse a plan that was not written here, as all that it says is only its writer's word.

    Whose an instance is, what its secrets hold, where its services run and who builds its images is believed by later
    runs of the user's own. An instance of which robots have nothing, or say so, may be one that is on others.
    `adopt` says that the user believes the writer. Then secrets that are right already are refused: their values are
    not read for it, so it may say of any that it comes from wherever it likes.

    Raises:
        RefusedError: It names where the instance is, or the secrets.
    """
    if not adopt:
        what = f"would change instance '{saved.plan.instance}'{_where(saved.plan.instance, snapshot)}"
        hint = "apply it with --signers FILE if it is signed, or --adopt if you believe its writer"
    elif kept := sorted(names_of(saved.also_wanted)):
        what = f"would use what is there of secrets: {', '.join(kept)}"
        hint = "apply it with --signers FILE if it is signed"
    else:
        return refuse_left_out(saved, wants, steps, snapshot)
    raise RefusedError(
        f"this plan was not written on this controller, and {what}",
        hint=f"plan its EDF here; or {hint}",
        code=Code.STRANGE_PLAN,
    )


def refuse_hidden(saved: PlanFile, snapshot: Snapshot) -> None:
    """Refuse a file from elsewhere that is not about robots that have had something of its instance, and answer.

    Raises:
        RefusedError: Names them.
    """
    hidden = sorted(saved.plan.unreachable.keys() & snapshot.facts.keys())
    beside = (had_it(saved) & snapshot.facts.keys()) - {*saved.fingerprints, *hidden}
    _refuse(
        [f"{robot} answers, and the plan says that it does not" for robot in hidden]
        + [f"{robot} has had some of it, and the plan is not about it" for robot in sorted(beside)]
    )


def refuse_left_out(
    saved: PlanFile, wants: Sequence[Resource], steps: Sequence[Step], snapshot: Snapshot
) -> None:  # fmt: skip
    """Refuse a file from elsewhere that hides what is there, or gives away what others of the instance have.

    A choice of its writer's leaves out what makes the rest right: whoever applies it chooses for himself.

    Raises:
        RefusedError: Names them.
    """
    chosen = ["its steps are only some of those that follow from it"] * bool(saved.limit or saved.targets)
    _refuse(chosen + sorted({*of_others(saved.plan.instance, wants, steps, snapshot)}))


def _refuse(wrong: Sequence[str]) -> None:
    if wrong:
        raise RefusedError(
            "this plan, which was not written here, leaves out what is there:\n" + "\n".join(wrong),
            hint="have all of its EDF planned, or plan it here; or apply it with --signers FILE if it is signed",
            code=Code.STRANGE_PLAN,
        )


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
