"""Whose data may be attached, copied, removed: only who has the token that made it, or says `--adopt`.

Takes what was found and who owns it; refuses, or writes down what was made and taken over.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping

from srprov.codes import Code
from srprov.controller.data import DataNow, roaming, used
from srprov.controller.owners import Owner, every_owner, keep
from srprov.definitions.model import Experiment
from srprov.errors import RefusedError
from srprov.facts.model import Snapshot
from srprov.modules import MODULES
from srprov.modules.volume import volume_name
from srprov.names import few
from srprov.planning.plan import Plan
from srprov.resource import Observed, Resource

_ADOPT = "take them over with their data by --adopt, or run it under another name with --instance NAME"


def check_owner(experiment: Experiment, placed: Mapping[str, str], now: DataNow) -> None:
    """Refuse to attach, or to pass over, volumes that somebody else made under the instance's name.

    Raises:
        RefusedError: Names them.
    """
    wanted = used(experiment, placed, now.instance)
    names = {volume for one in experiment.services.values() for volume in roaming(one, now.instance)}
    refuse_strange(
        [
            (robot, item)
            for robot, item in now.held.strange
            if item not in now.held.there.get(item.name, {}).values()
            and ((robot, item.name) in wanted or (item.name in names and not now.held.there.get(item.name)))
        ]
    )


def check_made_for(experiment: Experiment, now: DataNow) -> None:
    """Refuse to give data that was made for other services to one whose CDF alone names it.

    A CDF may be a stranger's, and data is kept when its service goes. Services of one CDF may have each other's. What
    an older srprov made says of nobody whose it is.

    Raises:
        RefusedError: Names each service and volume.
    """
    wrong = []
    for name, service in sorted(experiment.services.items()):
        for volume in sorted(service.by_cdf):
            for robot, item in sorted(now.held.there.get(volume_name(now.instance, volume), {}).items()):
                owners = item.state.get("services", ())
                elsewhere = service.per_robot is not None and robot != service.robot  # each has what is on its robot
                if not elsewhere and owners and {service.instance_of or name, *service.same_cdf}.isdisjoint(owners):
                    wrong.append(f"the CDF of {name} mounts '{volume}', whose data on {robot} is of {few(owners, 3)}")
    if wrong:
        hint = "name it in the `volumes` of this service in the EDF, if it shall have that data; else rename it"
        raise RefusedError("; ".join(wrong), hint=hint, code=Code.OWNER)


def refuse_strange(found: Collection[tuple[str, Observed]], hint: str = _ADOPT) -> None:
    """Refuse volumes whose token this controller does not have.

    Raises:
        RefusedError: There is one.
    """
    if found:
        named = ", ".join(
            f"{item.name} on {robot}" for robot, item in sorted(found, key=lambda one: (one[1].name, one[0]))
        )
        raise RefusedError(
            f"these volumes were not made from this file on this controller: {named}",
            hint=hint,
            code=Code.OWNER,
        )


def remember_owner(plan: Plan, owner: Owner | None) -> None:
    """Write down who owns an instance, and the volumes that a plan makes or takes over, before it is done or kept.

    Raises:
        UsageError: That cannot be written.
    """
    steps = [step for step in plan.steps if MODULES[step.module].holds_data]
    if owner:
        gone = {step.name for step in steps if owner.places.get(step.name) == step.host}
        made = {step.name: step.host for step in steps if step.want is not None}
        places = {name: robot for name, robot in owner.places.items() if name not in gone} | made
        keep(dataclasses.replace(owner, source=plan.source, places=places))


def check_saved(plan: Plan, wants: Collection[Resource], snapshot: Snapshot, owners: Collection[Owner]) -> None:
    """Refuse a plan from a file that would attach, move or remove data of others than `owners`, who wrote the file.

    `wants` is all that it wants, also what is right already.

    Raises:
        RefusedError: Names the volumes.
    """
    uses = {use for want in wants for use in _uses(want.host, want)}
    uses |= {(step.host, step.name) for step in plan.steps if MODULES[step.module].holds_data}
    found = {
        (robot, item.name): item
        for robot, items in snapshot.observed.items()
        for item in items
        if (robot, item.name) in uses and MODULES[item.module].holds_data
    }
    if not found:
        return
    strange = {
        use: item
        for use, item in found.items()
        if item.instance != plan.instance or not any(_may_use(owner, use[0], item) for owner in owners)
    }
    for want in wants:
        source = (MODULES[want.module].taken_from(want.params), want.name)
        if (item := found.get(source)) and not any(_proves(owner, want, source[0], item) for owner in owners):
            strange[source] = item
    hint = "a plan that was written here may use what was made here: plan the EDF here, if need be with --adopt"
    refuse_strange([(robot, item) for (robot, _), item in strange.items()], hint)


def refuse_labels(wants: Collection[Resource], *, trusted: bool) -> None:
    """Refuse a plan that was not written here, and says whose its volumes are.

    A label is no secret: it stands in every plan that was handed on, and on the robot. Whose it is can be told only by
    who has the token: one of an owner here is always refused, any other one unless the user trusts the plan's author.

    Raises:
        RefusedError: Names the volumes.
    """
    made = [
        (want.host, Observed(module=want.module, name=want.name, instance="", state={"owner": label, "created": ""}))
        for want in wants
        if MODULES[want.module].holds_data and (label := want.params.owner)
    ]
    owners = every_owner() if made else ()
    ours = [one for one in made if any(owner.knows(*one) for owner in owners)]
    if strange := ours or ([] if trusted else made):
        hint = "plan its EDF here" + ("" if ours else "; or let it make them by --adopt, or by --signers FILE")
        raise RefusedError(
            "only this plan, which was not written here, says who made these volumes: "
            + ", ".join(sorted(f"{item.name} on {robot}" for robot, item in strange)),
            hint=hint,
            code=Code.STRANGE_PLAN,
        )


def _may_use(owner: Owner, robot: str, item: Observed) -> bool:
    """Return whether a volume is an owner's, or what a copy that was cut off left, which has no label."""
    return owner.knows(robot, item) or not MODULES[item.module].keeps(item.state)


def _proves(owner: Owner, want: Resource, source: str, item: Observed) -> bool:
    """Return whether a wanted copy carries the owner's word for what it replaces: a file could say any."""
    return bool(want.params.copy == owner.copy_label(source, item.state["created"], want.host, want.name))


def _uses(host: str, want: Resource) -> Iterator[tuple[str, str]]:
    """Return robot and name of the volumes that a resource mounts, or is copied from."""
    mounts = getattr(want.params, "mounts", ())
    yield from ((host, str(mount.get("Source", ""))) for mount in mounts if mount.get("Type") == "volume")
    if source := MODULES[want.module].taken_from(want.params):
        yield source, want.name
