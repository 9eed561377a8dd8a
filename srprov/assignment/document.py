"""An Assignment as JSON: what `assign --json` prints; `schemas/assign.schema.json` describes it.

Takes values, gives JSON values in a fixed order. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from srprov.assignment.fairness import Point
from srprov.assignment.model import Assignment
from srprov.errors import NoAssignment


def assign_json(answer: Assignment, front: Sequence[Point] = ()) -> dict[str, Any]:
    """Return the document; `gap` only where the search was stopped, `pareto` only where it was asked for."""
    document: dict[str, Any] = {
        "assignment": dict(answer.placed),
        "cost": answer.cost,
        "optimal": answer.optimal,
        "matrix": {service: dict(row) for service, row in answer.matrix.items()},
        "why_not": {service: dict(row) for service, row in answer.why_not.items()},
        "pools": dict(sorted(answer.pools.items())),
        "jain": answer.jain,
    }
    if answer.gap:
        document["gap"] = answer.gap
    if front:
        document["pareto"] = [
            {"fairness": one.fairness, "cost": one.cost, "jain": one.jain, "assignment": dict(one.placed)}
            for one in front
        ]
    return document


def refusal_json(error: NoAssignment) -> dict[str, Any]:
    """Return the document where there is no placement: what is in the way, and what would help."""
    return {"assignment": None, "code": error.code, "error": error.message, "why_not": error.misses, "hint": error.hint}
