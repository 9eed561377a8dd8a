"""What a plan does about data: what is copied, what is left, what is kept and used by nobody.

Takes where data is and where services are placed; gives a `DataPlan`. Pure.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType

import msgspec

from srprov.codes import Code
from srprov.controller.data import DataNow, Holdings, mounted, newest, roaming, used
from srprov.controller.data_owner import check_made_for, check_owner
from srprov.controller.owners import Owner
from srprov.controller.request import PlanRequest
from srprov.definitions.model import Experiment
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.names import few
from srprov.planning.plan import DataMove


class DataPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What a plan does about data."""

    moves: tuple[DataMove, ...] = ()
    owner: Owner | None = None
    copies: Mapping[tuple[str, str], tuple[str, str]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot and name of a volume -> the robot that it is copied from, and the copy's label."""
    notes: tuple[str, ...] = ()


def plan_data(
    experiment: Experiment, placed: Mapping[str, str], now: DataNow, snapshot: Snapshot, request: PlanRequest
) -> DataPlan:
    """Return what becomes of the data when services run where they are placed.

    Raises:
        RefusedError: It is somebody else's; or it was to be copied, and cannot be.
    """
    if request.owner:
        check_owner(experiment, placed, now)
        check_made_for(experiment, now)
    moves = tuple(_moves(experiment, placed, now, snapshot, request.data))
    if request.data == "move":
        for one in moves:
            _check_copy(one, now.held, snapshot)
    finished = tuple(_finished(experiment, placed, now)) if request.data == "move" else ()
    return DataPlan(
        moves=(*moves, *finished),
        owner=_with_adopted(request, now.held),
        copies=_copies(moves, now.held, request),
        notes=tuple(_kept_notes(experiment, placed, now, moves, request.data)),
    )


def _moves(
    experiment: Experiment, placed: Mapping[str, str], now: DataNow, snapshot: Snapshot, how: str
) -> Iterator[DataMove]:
    """Return what becomes of data whose service goes to another robot."""
    for name, service in sorted(experiment.services.items()):
        target, home = placed.get(name, ""), now.home.get(name)
        for volume in roaming(service, now.instance) if target in snapshot.facts else ():
            having = now.held.there.get(volume, {})
            source = home if home in having or home in snapshot.unreachable else newest(having)
            if source and source != target:
                yield DataMove(service=name, volume=volume, source=source, target=target, how=how)


def _finished(experiment: Experiment, placed: Mapping[str, str], now: DataNow) -> Iterator[DataMove]:
    """Return the moves of which only the removal is left: the copy is whole, and its source is still there."""
    for name, service in sorted(experiment.services.items()):
        target = placed.get(name, "")
        for volume in roaming(service, now.instance):
            if source := now.held.copied.get((target, volume)):
                yield DataMove(service=name, volume=volume, source=source, target=target, how="move")


def _check_copy(move: DataMove, held: Holdings, snapshot: Snapshot) -> None:
    leave = "--data leave starts without it, and it stays there"
    if move.source in snapshot.unreachable:
        why = f"the data of {move.service} is on {move.source}, which cannot be reached, so it cannot be moved"
        raise RefusedError(why, hint=leave, code=Code.NEEDED_ROBOT)
    copied_away = any(name == move.volume and source == move.target for (_, name), source in held.copied.items())
    if copied_away or move.target in held.there.get(move.volume, {}):
        why = f"{move.target} has a volume {move.volume} with data of its own, which the data of {move.service} on"
        hint = f"--data leave uses the one on {move.target}; or remove that one first, with docker volume rm"
        raise RefusedError(f"{why} {move.source} cannot replace", hint=hint, code=Code.IN_THE_WAY)


def _copies(
    moves: Collection[DataMove], held: Holdings, request: PlanRequest
) -> dict[tuple[str, str], tuple[str, str]]:
    """Return what is copied from where.

    A copy that is whole already is among them with `--data move`, until what it was copied from is gone.
    """
    if request.data != "move":
        return {}
    copies = {}
    for one in moves:
        created = held.there[one.volume][one.source].state["created"]
        label = request.owner.copy_label(one.source, created, one.target, one.volume) if request.owner else ""
        copies[(one.target, one.volume)] = (one.source, label)
    for (target, volume), source in held.copied.items():
        copies[(target, volume)] = (source, held.there[volume][target].state["copy"])
    return copies


def _kept_notes(
    experiment: Experiment, placed: Mapping[str, str], now: DataNow, moves: Collection[DataMove], how: str
) -> Iterator[str]:
    """Return a line for each volume that is kept and that no service will use where it is."""
    wanted = used(experiment, placed, now.instance) | {(one.source, one.volume) for one in moves}
    for name, robots in sorted(now.held.there.items()):
        for robot in sorted(robots):
            if (robot, name) not in wanted:
                yield f"data volume {name} on {robot} is kept, and no service uses it there"
    yield from _inherited(experiment, placed, now)
    for (target, name), source in sorted(now.held.copied.items()):
        if how != "move":
            yield f"data volume {name} is still on {source}, and whole on {target}; --data move removes it on {source}"


def _inherited(experiment: Experiment, placed: Mapping[str, str], now: DataNow) -> Iterator[str]:
    """Return a line for each volume with data of services that have it no more: what lies there is theirs."""
    users: dict[tuple[str, str], set[str]] = {}
    for name, one in experiment.services.items():
        for volume in mounted(one, now.instance):
            users.setdefault((placed.get(name, ""), volume), set()).add(one.instance_of or name)
    for (robot, volume), some in sorted(users.items()):
        item = now.held.there.get(volume, {}).get(robot)
        owners = item.state.get("services", ()) if item else ()
        if owners and some.isdisjoint(owners):
            had, has = (few(sorted(names), 3) for names in (owners, some))
            yield f"data volume {volume} on {robot} has the data of {had}, and {has} has it now"


def _with_adopted(request: PlanRequest, held: Holdings) -> Owner | None:
    """Return the owner with what `--adopt` takes over."""
    if request.owner is None or not request.adopt:
        return request.owner
    return dataclasses.replace(request.owner, adopted=request.owner.adopted | held.adopted)
