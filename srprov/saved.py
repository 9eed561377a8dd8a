"""Plans that are kept: from what was planned to a file, and back to a plan that may be applied.

Reads the definition files, and asks robots what moved; changes nothing.
"""

from __future__ import annotations

import dataclasses
import os

import srprov
from srprov import disk
from srprov.controller import Planned
from srprov.definitions.model import Definitions, Inventory
from srprov.errors import StalePlan, UsageError
from srprov.facts.gather import Readers, gather
from srprov.planning import Plan
from srprov.planning.fingerprint import fingerprints
from srprov.planning.planfile import PlanFile, differences


def to_file(planned: Planned, plan: Plan, definitions: Definitions) -> PlanFile:
    """Give what `plan -o` writes: `plan` (which may be limited to some robots), its inputs, and what it relies on.

    The inventory is not among the inputs: it may hold passwords.
    """
    folder = definitions.experiment.folder
    files = {definitions.experiment.file, *definitions.containers}
    inputs = {os.path.relpath(path, folder): disk.read(path).decode("utf-8", "replace") for path in sorted(files)}
    return PlanFile(
        plan=plan, fingerprints=fingerprints(plan, planned.found), inputs=inputs, made_by=srprov.__version__
    )


def check_file(saved: PlanFile, lab: Inventory, readers: Readers, *, forks: int = 64) -> Plan:
    """Give the plan of a file when nothing that it relies on has moved; robots out of reach are noted in it.

    Raises:
        StalePlan: Names what moved on which robot.
        UsageError: A robot of the plan is not in the inventory.
    """
    missing = sorted(set(saved.fingerprints) - set(lab.hosts))
    if missing:
        raise UsageError(
            f"the plan is for robots that are not in the inventory: {', '.join(missing)}",
            hint="use the inventory that the plan was made with, or plan again",
        )
    part = dataclasses.replace(lab, hosts={name: lab.hosts[name] for name in sorted(saved.fingerprints)})
    found = gather(part, readers, sample=False, forks=forks)
    now = fingerprints(saved.plan, found)
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
    return dataclasses.replace(saved.plan, unreachable={**saved.plan.unreachable, **found.unreachable})
