"""One hash of what a plan would do, for whoever reviewed it: equal robots and equal files give the same one. Pure.

It covers the steps with their commands, order and waits, where services are placed, what is asked for, and where links
lead that are on the way of a path that a new container mounts. It does not cover what only says why or how things are:
causes, values that were found, costs, notes, robots out of reach.
"""

from __future__ import annotations

import re
from typing import Any

from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import StalePlan, UsageError
from srprov.modules.module import digest
from srprov.planning.plan import Plan, Step, command_json, plan_json

_COVERED = ("plan", "instance", "source", "assignment", "permissions", "secrets", "playbooks", "data")
_SHORTEST = 32
"""Digits of a hash that somebody may give instead of all 64. Who writes two plans finds some with fewer equal ones."""
_GIVEN = re.compile(rf"(?:sha256:)?([0-9a-fA-F]{{{_SHORTEST},64}})")


def plan_hash(plan: Plan) -> str:
    """Return the sha256, in hex."""
    document = plan_json(replace(plan, steps=()))
    led = {robot: moved for robot, some in plan.leads.items() if (moved := {k: v for k, v in some.items() if k != v})}
    steps = [_done(step) for step in plan.steps]
    return digest({**{key: document[key] for key in _COVERED}, "steps": steps, **({"leads": led} if led else {})})


def shown_json(plan: Plan) -> dict[str, Any]:
    """Return what `plan --json` prints: the plan with its hash."""
    return {**plan_json(plan), "hash": plan_hash(plan)}


def expected_hash(text: str) -> str:
    """Return what somebody gave as a plan's hash: at least 32 of its digits.

    Raises:
        UsageError: It is none.
    """
    given = _GIVEN.fullmatch(text)
    if given is None:
        raise UsageError(
            f"{text[:80]!r} is not the hash of a plan",
            hint=f"`srprov plan` shows it; at least {_SHORTEST} of its hexadecimal digits are needed",
            code=Code.OPTION_VALUE,
        )
    return given[1].lower()


def check_hash(plan: Plan, expected: str) -> None:
    """Refuse a plan that would do something else than the one that was reviewed, whose hash begins with `expected`.

    Raises:
        StalePlan: It would.
    """
    if not (now := plan_hash(plan)).startswith(expected):
        raise StalePlan(
            f"this is not the plan that was reviewed, and nothing was changed: its hash is {now}, not {expected}",
            hint="review it again: `srprov plan` shows what would change now, and its hash",
        )


def _done(step: Step) -> dict[str, Any]:
    """Return what a step does, as JSON."""
    return {
        "id": step.id,
        "action": step.change.action.name,
        "destructive": step.change.destructive,
        "needs": list(step.needs),
        "waits": [[need.id, need.condition] for need in step.waits],
        "commands": [command_json(command) for command in step.commands],
    }
