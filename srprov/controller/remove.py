"""The plan that takes everything of an instance away; it needs no EDF, only labels."""

from __future__ import annotations

from srprov.controller.data import holdings
from srprov.controller.data_owner import refuse_strange
from srprov.controller.fleet import Fleet
from srprov.controller.owners import Owner
from srprov.controller.ownership import check_source, looking, makers_of, owned
from srprov.controller.plan import Planned
from srprov.facts.gather import Detail
from srprov.facts.model import Snapshot
from srprov.modules import MODULES
from srprov.network.record import read_record
from srprov.planning.diff import removal_plan
from srprov.planning.plan import Plan


def make_removal(
    fleet: Fleet, instance: str, *, volumes: bool, source: str = "", adopt: bool = False, owner: Owner | None = None
) -> Planned:
    """Say what would take everything of an instance away.

    Args:
        fleet: The robots.
        instance: The instance's id.
        volumes: Data volumes too.
        source: Where the experiment comes from; empty: whoever made the instance.
        adopt: Also when another source made it.
        owner: Who may remove its data; None: whoever names the instance.

    Raises:
        RefusedError: `source` is given and another source made the instance; or what would go is another's data.
    """
    looked = looking(fleet.gather(Detail.BASIC), instance)
    snapshot = looked.snapshot
    if source:
        check_source(snapshot, instance, source, adopt=adopt)
    if volumes and not adopt:
        refuse_strange(holdings(snapshot, instance, owner, adopt=False).strange)
    steps = removal_plan(owned(snapshot, instance), instance, volumes=volumes)
    known = read_record(snapshot.placements.get(instance))
    away = sorted({robot for robot in (known.robots.values() if known else ()) if robot in snapshot.unreachable})
    notes = [
        *looked.disputes,
        *looked.notes,
        *(
            f"{robot} holds services of this instance and cannot be reached; destroy again when it is back"
            for robot in away
        ),
    ]
    kept = _data(snapshot, instance)
    if kept and not volumes:
        notes.append(f"{len(kept)} data volume(s) stay: {', '.join(sorted(set(kept)))}; --volumes removes them")
    plan = Plan(
        instance=instance,
        source=source or (known.source if known else ""),
        steps=steps,
        notes=tuple(notes),
        unreachable=snapshot.unreachable,
    )
    makers = makers_of(snapshot, instance, plan.source)
    return Planned(plan=plan, snapshot=snapshot, makers=makers, owner=owner if volumes else None)


def other_instances(snapshot: Snapshot, instance: str, source: str) -> list[str]:
    """Return instances on the robots that came from the same source under another name."""
    every = (item for items in snapshot.observed.values() for item in items)
    owners = {item.instance for item in every if source and item.state.get("source") == source}
    return sorted(owners - {instance, ""})


def _data(snapshot: Snapshot, instance: str) -> list[str]:
    every = (item for items in snapshot.observed.values() for item in items)
    return [item.name for item in every if MODULES[item.module].keeps(item.state) and item.instance == instance]
