"""What is not as it should be, and is left alone all the same: jobs that failed, services that are unhealthy. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from srprov.modules import MODULES, RUNNING
from srprov.planning.steps import There, due_step
from srprov.resource import Action, Observed, Resource


def amiss(resource: Resource, item: Observed | None) -> str:
    """Return what is wrong with what runs a service, if no plan mends it; else nothing.

    What is made anew for another reason is not left alone.
    """
    if item is None or resource.module not in RUNNING:
        return ""
    why = RUNNING[resource.module].amiss(resource.params, item.state)
    if not why:
        return ""
    due = due_step(resource, item)
    return why if due is None or due.change.action is Action.UPDATE else ""


def all_notes(
    wanted: Iterable[Resource], observed: Mapping[str, Iterable[Observed]]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the notes on what is not as it should be, and on what differs from what is wanted and is right so."""
    there = {(host, one.module, one.name): one for host, items in observed.items() for one in items}
    ordered = sorted(wanted, key=lambda one: one.id)
    return tuple(notes(ordered, there)), tuple(_left_alone(ordered, there))


def _left_alone(wanted: Iterable[Resource], there: There) -> Iterator[str]:
    for one in wanted:
        item = there.get((one.host, one.module, one.name))
        if item and (why := MODULES[one.module].left_alone(one.params, item.state)):
            yield f"{one.name} on {one.host} {why}"


def notes(wanted: Iterable[Resource], there: There) -> Iterator[str]:
    """Return a note for each, with what the user can do."""
    for one in sorted(wanted, key=lambda one: one.id):
        if why := amiss(one, there.get((one.host, one.module, one.name))):
            yield f"{one.service} on {one.host} {why}, and is left so; `srprov restart` starts it again"
