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
from srprov.definitions.secretmodel import SecretSource
from srprov.errors import StalePlan, UsageError
from srprov.facts.gather import Detail, Readers, gather, probe
from srprov.facts.model import Snapshot
from srprov.modules.secret import with_value
from srprov.planning.fingerprint import fingerprints
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, differences
from srprov.secret import Vault


def to_file(planned: Planned, plan: Plan, definitions: Definitions) -> PlanFile:
    """Return what `plan -o` writes: `plan` (which may be limited to some robots), its inputs, and what it relies on.

    The inventory is not among the inputs: it may hold passwords.
    """
    folder = definitions.experiment.folder
    files = {definitions.experiment.file, *definitions.containers}
    inputs = {os.path.relpath(path, folder): disk.read(path).decode("utf-8", "replace") for path in sorted(files)}
    # as they were rendered: the record says what ran, not what lies there by now
    inputs |= {os.path.relpath(one.file, folder): one.text for one in planned.playbooks}
    return PlanFile(
        plan=plan, fingerprints=fingerprints(plan, planned.snapshot), inputs=inputs, made_by=srprov.__version__
    )


def removal_file(plan: Plan, snapshot: Snapshot) -> PlanFile:
    """Return a removal as a plan file, for the record; it has no inputs."""
    return PlanFile(plan=plan, fingerprints=fingerprints(plan, snapshot), made_by=srprov.__version__)


def needed(saved: PlanFile) -> tuple[SecretSource, ...]:
    """Return the sources of the secrets that the plan's steps write."""
    written = {step.want.params["name"] for step in saved.plan.steps if step.module == "secret" and step.want}
    return tuple(source for source in saved.plan.secrets if source.name in written)


def check_file(saved: PlanFile, inventory: Inventory, readers: Readers, *, vault: Vault, forks: int = 64) -> Plan:
    """Return the plan of a file when nothing that it relies on has moved; robots out of reach are noted in it.

    The file holds no secret: its steps get the values of now from the vault.

    Raises:
        StalePlan: Names what moved on which robot.
        UsageError: A robot of the plan is not in the inventory.
    """
    missing = sorted(set(saved.fingerprints) - set(inventory.hosts))
    if missing:
        raise UsageError(
            f"the plan is for robots that are not in the inventory: {', '.join(missing)}",
            hint="use the inventory that the plan was made with, or plan again",
        )
    part = dataclasses.replace(inventory, hosts={name: inventory.hosts[name] for name in sorted(saved.fingerprints)})
    found = gather(part, readers, closer=Detail.ENGINE, forks=forks)
    found = probe(found, [step.want for step in saved.plan.steps if step.want], readers, forks=forks)
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
    steps = tuple(
        dataclasses.replace(step, want=with_value(step.want, vault)) if step.want else step for step in saved.plan.steps
    )
    return dataclasses.replace(saved.plan, steps=steps, unreachable={**saved.plan.unreachable, **found.unreachable})
