"""Plans that are kept: from what was planned to a file, and back to a plan that may be applied.

Reads the definition files, and asks robots what moved; changes nothing.
"""

from __future__ import annotations

import dataclasses
import os

import srprov
from srprov import disk
from srprov.controller.data_owner import check_saved, remember_owner
from srprov.controller.fleet import Fleet
from srprov.controller.permissions import require_decided
from srprov.controller.plan import Planned
from srprov.errors import StalePlan, UsageError
from srprov.facts.gather import Detail, Gathering
from srprov.modules.secret import with_value
from srprov.planning.fingerprint import fingerprints
from srprov.planning.planfile import PlanFile, differences
from srprov.secret import Vault


def plan_file(planned: Planned) -> PlanFile:
    """Return what `plan -o` writes and a run records: the plan, its inputs, and what it relies on.

    The inventory is not among the inputs: it may hold passwords.
    """
    if planned.saved:
        return dataclasses.replace(planned.saved, plan=planned.plan)
    assert planned.snapshot is not None  # only a plan from a file has none
    return PlanFile(
        plan=planned.plan,
        fingerprints=fingerprints(planned.plan, planned.snapshot),
        inputs=_inputs(planned),
        made_by=srprov.__version__,
    )


def kept_plan(planned: Planned) -> PlanFile:
    """Return the plan for a file, and write down who owns the volumes that it makes or takes over.

    Raises:
        RefusedError: It would leave data behind, and the user has not said so.
        UsageError: Who owns the volumes cannot be written down.
    """
    require_decided(planned.plan.data)
    remember_owner(planned.plan, planned.owner)
    return plan_file(planned)


def _inputs(planned: Planned) -> dict[str, str]:
    """Return name -> text of the definition files; a removal has none."""
    if planned.definitions is None:
        return {}
    folder = planned.definitions.experiment.folder
    files = {planned.definitions.experiment.file, *planned.definitions.containers}
    inputs = {os.path.relpath(path, folder): disk.read(path).decode("utf-8", "replace") for path in sorted(files)}
    # as they were rendered: the record says what ran, not what lies there by now
    return inputs | {os.path.relpath(one.file, folder): one.text for one in planned.playbooks}


def check_plan(saved: PlanFile, fleet: Fleet, vault: Vault) -> Planned:
    """Return the plan of a file when nothing that it relies on has moved; robots out of reach are noted in it.

    The file holds no secret: its steps get the values of now from the vault.

    Raises:
        StalePlan: Names what moved on which robot.
        RefusedError: It would use data that was not made here from its source.
        UsageError: A robot of the plan is not in the inventory.
    """
    missing = sorted(set(saved.fingerprints) - set(fleet.inventory.hosts))
    if missing:
        raise UsageError(
            f"the plan is for robots that are not in the inventory: {', '.join(missing)}",
            hint="use the inventory that the plan was made with, or plan again",
        )
    hosts = {name: fleet.inventory.hosts[name] for name in sorted(saved.fingerprints)}
    part = dataclasses.replace(fleet.inventory, hosts=hosts)
    with Gathering(part, fleet.sessions.get, engine=True, forks=fleet.forks) as look:
        snapshot = look.probe(look.closer(Detail.ENGINE), [step.want for step in saved.plan.steps if step.want])
    now = fingerprints(saved.plan, snapshot)
    check_saved(saved.plan, snapshot)
    moved = [
        f"{host}: {difference}"
        for host in sorted(now)
        for difference in differences(saved.fingerprints[host], now[host])
    ]
    if moved:
        raise StalePlan(
            "robots changed since the plan was made:\n" + "\n".join(f"  {line}" for line in moved),
            hint="plan again, review it again, then apply that",
        )
    steps = tuple(
        dataclasses.replace(step, want=with_value(step.want, vault)) if step.want else step for step in saved.plan.steps
    )
    unreachable = {**saved.plan.unreachable, **snapshot.unreachable}
    return Planned(plan=dataclasses.replace(saved.plan, steps=steps, unreachable=unreachable), saved=saved)
