"""Which robots the lab has, by what the last `up` wanted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from srprov.codes import Code
from srprov.errors import LabError, UsageError
from srprov.lab import spec, state
from srprov.lab.places import Site


def of(lab: state.Lab) -> list[spec.Robot]:
    """The robots of a lab in the order of their numbers."""
    parsed = spec.parse(lab.spec["text"], lab.spec["file"])
    return parsed.build(lab.spec["count"] or parsed.count or max(spec.DEFAULT_COUNT, parsed.least))


def require_up(site: Site) -> state.Lab:
    """Return the lab; LabError if it is down."""
    lab = state.read_lab(site)
    if lab is None:
        raise LabError(f"{site.title} is down", hint=f"{site.command} up", code=Code.LAB_DOWN)
    return lab


@contextmanager
def changing(site: Site) -> Iterator[None]:
    """Let no other command change the lab meanwhile; LabError if it is down."""
    require_up(site)
    with state.locked(site.run):
        yield


def one(site: Site, name: str) -> spec.Robot:
    """The robot of that name; an error if the lab has none."""
    robots = {each.name: each for each in of(require_up(site))}
    if name not in robots:
        raise UsageError(f"the lab has no {name}", hint=f"it has {', '.join(robots)}", code=Code.LAB_ORDER)
    return robots[name]
