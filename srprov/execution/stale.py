"""Whether a step may still be done on what is there: others may have been on the robot since the plan was made. Pure.

A question may stand for an hour, and nothing is locked meanwhile. What was shown is done on what was seen: a record
that came since says whose the instance is by now, and data in a volume is of who made it.
"""

from __future__ import annotations

from srprov.execution.outcome import Outcome, StepResult
from srprov.modules import MODULES, PROBING
from srprov.modules.container_params import ContainerParams
from srprov.modules.volume import VolumeParams, half_copy
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Observed, resource_id

_CHANGED = "the robot changed since the plan was made: now {}; plan again"
_WHOSE = ("source", "owner")
"""What the state of a thing says of who made it."""


def due(step: Step, item: Observed | None) -> Change | None:
    """Return what is to be done for a step of a plan, by what is there now."""
    if step.want is not None:
        return MODULES[step.module].check(step.name, step.want.params, item.state if item else None)
    return Change(action=Action.DELETE, cause="still there") if item else None


def refused(step: Step, item: Observed | None, change: Change | None) -> StepResult | None:
    """Say why a step is not to be done, or nothing.

    Args:
        step: Of the plan.
        item: What is there now.
        change: What is due now.
    """
    if item is not None and _is_anothers(step, item):
        return _failed(step, "it is there, and somebody else made it")
    if change is None:
        why = "its check holds by now" if step.module in PROBING else "somebody was faster"
        return StepResult(step=step, outcome=Outcome.UNCHANGED, message=why)
    if step.want is not None and (change.commands != step.commands or _is_another_file(step, item)):
        return _failed(step, change.cause)
    if step.want is None and item is not None and _is_another_file(step, item):
        return _failed(step, "content differs")
    return None


def made_on_the_way(step: Step) -> frozenset[str]:
    """Return ids of what a step makes and removes again: where it fails, that may stay, whatever removed one before."""
    makes = step.want is not None and isinstance(step.want.params, VolumeParams)
    return frozenset({resource_id(step.host, step.module, half_copy(step.name))} if makes else ())


def _failed(step: Step, why: str) -> StepResult:
    return StepResult(step=step, outcome=Outcome.FAILED, message=_CHANGED.format(why))


def _is_anothers(step: Step, item: Observed) -> bool:
    """Return whether somebody else made what is there than what the plan found, or is to make."""
    if before := step.change.before:
        return any(key in before and item.state.get(key) != before[key] for key in _WHOSE)
    want = step.want.params if step.want else None
    if isinstance(want, VolumeParams):
        return bool(item.state["owner"] != want.owner)
    return isinstance(want, ContainerParams) and item.state["source"] != want.source


def _is_another_file(step: Step, item: Observed | None) -> bool:
    """Return whether another file is there than the plan found: one is written whole, whatever it takes the place of.

    Of the record that says whose an instance is, that would be another experiment's.
    """
    before, now = step.change.before, item.state if item else None
    return step.module == "file" and (before or {}).get("sha256") != (now or {}).get("sha256")
