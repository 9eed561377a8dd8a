"""A user's `stop`, `start` and `restart` of services that are there, as a plan, so that it is done as any other.

Takes where services are and what the EDF says of their order; touches nothing.
"""

from __future__ import annotations

import graphlib
from collections.abc import Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.controller.located import Located, Whereabouts
from srprov.controller.ownership import makers_of
from srprov.controller.plan import Planned
from srprov.definitions.model import Service
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING
from srprov.planning.plan import Plan, Step
from srprov.resource import Action, Change, Condition, Need, Observed, resource_id

_SLOW = (Condition.HEALTHY.value, Condition.COMPLETED.value)


class Order(msgspec.Struct, frozen=True, kw_only=True):
    """What a user wants done."""

    verb: str
    """`stop`, `start` or `restart`."""
    words: tuple[str, ...] = ()
    """Services; none: all of them, and of jobs that have ended none is started."""


def make_order(order: Order, there: Whereabouts, snapshot: Snapshot, services: Mapping[str, Service]) -> Planned:
    """Say what would stop or start services.

    Args:
        order: What is wanted.
        there: Where services are.
        snapshot: The robots as they are.
        services: By name, what the EDF says of each instance; empty where it is not valid any more.

    Raises:
        UsageError: A service that was named has no container, or is none of the instance's.
    """
    chosen = there.named(order.words)
    here = [one for one in chosen if one.found is not None]
    gone = [one for one in chosen if one.found is None and one.host not in snapshot.unreachable]
    if gone and order.words:
        raise UsageError(f"{gone[0].where} has no container", hint="`srprov apply` makes one", code=Code.NOTHING_RUNS)
    ordered = _in_order(here, services, backwards=order.verb == "stop")
    steps: list[Step] = []
    for one in ordered:
        if step := _step(one, order, services.get(one.service), steps, there, services):
            steps.append(replace(step, number=len(steps) + 1))
    notes = [f"{one.where} has no container; `srprov apply` makes one" for one in gone]
    notes += _left_alone(order, here, services)
    notes += [] if services else [_without_edf(order)]
    plan = Plan(
        instance=there.instance,
        source="",
        steps=tuple(steps),
        unchanged=len(here) - len(steps),
        notes=(*there.notes, *notes),
        unreachable={one.host: snapshot.unreachable[one.host] for one in chosen if one.host in snapshot.unreachable},
    )
    return Planned(plan=plan, snapshot=snapshot, makers=makers_of(snapshot, there.instance))


def _in_order(some: Sequence[Located], services: Mapping[str, Service], *, backwards: bool) -> list[Located]:
    """Return services so that each comes after those that it depends on, or before them."""
    by_name: dict[str, list[Located]] = {}
    for one in some:
        by_name.setdefault(one.service, []).append(one)
    needs = {name: sorted(services[name].depends_on) if name in services else [] for name in sorted(by_name)}
    names = [name for name in graphlib.TopologicalSorter(needs).static_order() if name in by_name]
    return [one for name in (reversed(names) if backwards else names) for one in by_name[name]]


def _step(
    one: Located, order: Order, service: Service | None, before: Sequence[Step], there: Whereabouts,
    services: Mapping[str, Service],
) -> Step | None:  # fmt: skip
    assert one.found is not None  # only what is there is stopped or started
    job = service.runtime.job if service else True
    found = replace(one.found, state={**one.found.state, "job": job})
    if not order.words and order.verb != "stop" and _has_ended(found):
        return None
    commands = RUNNING[found.module].order(found, order.verb)
    if not commands:
        return None
    stops = order.verb == "stop"
    near = {name for name in services if one.service in services[name].depends_on} if stops else set()
    near |= set(service.depends_on) if service and not stops else set()
    return Step(
        number=0,
        host=one.host,
        module=found.module,
        name=one.container,
        change=Change(action=Action.UPDATE, cause=order.verb, before=one.found.state, commands=commands),
        needs=tuple(step.number for step in before if step.service in near),
        waits=() if stops or service is None else _waits(service, there),
        found=found,
        order=order.verb,
    )


def _has_ended(found: Observed) -> bool:
    return bool(found.state["job"]) and found.state["state"] == "exited"


def _without_edf(order: Order) -> str:
    """Return the note that nothing is known of order and jobs."""
    ended = "; none that has ended is started: name those" if order.verb == "start" and not order.words else ""
    return f"the EDF is not valid: services are taken in the order of their names{ended}"


def _left_alone(order: Order, here: Sequence[Located], services: Mapping[str, Service]) -> list[str]:
    """Return a note for each job that is not started since nobody named it, and that has not ended well."""
    if order.verb == "stop" or order.words:
        return []
    jobs = [one for one in here if one.found and one.service in services and services[one.service].runtime.job]
    return [
        f"{one.where} is a job that ended with code {one.found.state['exit_code']}; name it to run it again"
        for one in jobs
        if one.found and one.found.state["state"] == "exited" and one.found.state["exit_code"]
    ]


def _waits(service: Service, there: Whereabouts) -> tuple[Need, ...]:
    """Return the conditions of what it depends on that take time."""
    slow = {other: how for other, how in service.depends_on.items() if how in _SLOW}
    needs = (
        Need(resource_id(one.host, _kind(one), one.container), slow[one.service])
        for one in there.services
        if one.service in slow and not one.stray
    )
    return tuple(sorted(needs))


def _kind(one: Located) -> str:
    return one.found.module if one.found else "container"
