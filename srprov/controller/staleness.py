"""Whether robots are still as a plan file found them; and if not, which values moved.

Compares fingerprints, which hold hashes of configurations; where only a hash moved, it asks the robot for the values
that are there now. Changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from srprov.controller.old_values import with_differences
from srprov.errors import StalePlan, visible
from srprov.facts.gather import Gathering
from srprov.facts.model import Snapshot
from srprov.planning.fingerprint import fingerprints
from srprov.planning.plan import Step
from srprov.planning.planfile import PlanFile, differences
from srprov.planning.steptext import value
from srprov.resource import Action, Change, Difference, Resource

_HASHED = ("hash", "parts", "sha256")
"""Keys of a state that are hashes: values say more."""
_MOST_LINES = 12
"""Lines of a file that are named."""


def refuse_stale(saved: PlanFile, wants: Sequence[Resource], snapshot: Snapshot, look: Gathering) -> None:
    """Refuse a plan file whose robots are not as it found them.

    Raises:
        StalePlan: Names what moved on which robot.
    """
    now = fingerprints(saved.plan, snapshot, wants, saved.fingerprints)
    moved = {host: differences(saved.fingerprints[host], one) for host, one in sorted(now.items())}
    if not any(moved.values()):
        return
    values = _values(saved, wants, snapshot, look, {host for host, lines in moved.items() if lines})
    lines = [f"{host}: {line}" for host, few in moved.items() for line in _with_values(few, values.get(host, {}))]
    raise StalePlan(
        "robots changed since the plan was made:\n" + "\n".join(f"  {line}" for line in lines),
        hint="plan again, review it again, then apply that",
    )


def refuse_unnoted(saved: PlanFile, noted: Sequence[str]) -> None:
    """Refuse a plan file that was written here, and does not tell what robots say by now of paths and devices.

    A container that is there may have put a link in the way of a path since somebody read the plan.

    Raises:
        StalePlan: Names what the plan does not tell.
    """
    if new := [one for one in noted if one not in saved.plan.notes]:
        told = "\n".join(f"  {visible(one)}" for one in new)
        raise StalePlan(
            f"robots changed since the plan was made, which does not say:\n{told}",
            hint="plan again, review it again, then apply that",
        )


def _with_values(lines: Sequence[str], values: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Return the lines, those about hashes of resources whose values are known replaced by lines about those."""
    told = set()
    for line in lines:
        resource = next((one for one in values if line.startswith(f"resources {one} ")), "")
        key = line.removeprefix(f"resources {resource} ").partition(":")[0]
        if resource and any(key == one or key.startswith(f"{one} ") for one in _HASHED):
            if resource not in told:
                told.add(resource)
                yield from (f"{resource}: {one}" for one in values[resource])
        else:
            yield line


def _values(
    saved: PlanFile, wants: Sequence[Resource], snapshot: Snapshot, look: Gathering, hosts: set[str]
) -> dict[str, dict[str, list[str]]]:
    """Return robot -> resource -> in words which of its values are not what they were when the plan was made."""
    filed = {step.id: step for step in saved.plan.steps if step.want}
    # one step for each that is there, whatever the plan does with it: only its values are asked for
    there = {(host, one.module, one.name) for host in hosts for one in snapshot.observed.get(host, ())}
    asked = [_step(one) for one in wants if (one.host, one.module, one.name) in there]
    found: dict[str, dict[str, list[str]]] = {}
    for step in with_differences(asked, snapshot.observed, wants, look):
        before = filed[step.id].differences if step.id in filed else ()
        if step.id in filed and not before:
            continue  # of a file that does not tell what it found
        if lines := list(_moved(before, step.differences)):
            found.setdefault(step.host, {})[f"{step.module}:{step.name}"] = lines
    return found


def _step(want: Resource) -> Step:
    change = Change(action=Action.UPDATE, cause="")
    return Step(number=0, host=want.host, module=want.module, name=want.name, change=change, want=want)


def _moved(before: Sequence[Difference], now: Sequence[Difference]) -> Iterator[str]:
    """Return in words which old values are others: those of a field that differs nowhere are the wanted ones."""
    then, here = ({one.field: one for one in side} for side in (before, now))
    for field in sorted(then.keys() | here.keys()):
        was, found = then.get(field), here.get(field)
        if was == found:
            continue
        if any(one and (one.note or one.diff) for one in (was, found)):
            yield from _in_words(field, was, found)
        else:
            old = was.old if was else found.new if found else None
            new = found.old if found else was.new if was else None
            yield f"{visible(field)}: was {value(old)}, is {value(new)}"


def _in_words(field: str, was: Difference | None, found: Difference | None) -> Iterator[str]:
    """Say of a file, a folder or a secret how it is not what it was."""
    name = visible(field)
    if found is None:
        yield f"{name}: is as the plan would make it"
    elif was is not None or found.note:
        yield f"{name}: changed since{f' ({visible(found.note)})' if found.note else ''}"
    else:  # it was right: what the diff would take away is there now
        for line in [line for line in found.diff if line.startswith(("-", "+"))][:_MOST_LINES]:
            yield f"{name}: {'is' if line.startswith('-') else 'was'} {value(line[1:])}"
