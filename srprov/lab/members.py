"""Which robots the lab has, by what the last `up` wanted."""

from __future__ import annotations

from srprov.errors import LabError, UsageError
from srprov.lab import spec, state


def of(lab: state.Lab) -> list[spec.Robot]:
    """The robots of a lab in the order of their numbers."""
    parsed = spec.parse(lab.spec["text"], lab.spec["file"])
    return parsed.build(lab.spec["count"] or parsed.count or max(spec.DEFAULT_COUNT, parsed.least))


def one(name: str) -> spec.Robot:
    """The robot of that name; an error if the lab has none."""
    lab = state.read_lab()
    if lab is None:
        raise LabError("the lab is down", hint="srprov lab up")
    robots = {each.name: each for each in of(lab)}
    if name not in robots:
        raise UsageError(f"the lab has no {name}", hint=f"it has {', '.join(robots)}")
    return robots[name]
