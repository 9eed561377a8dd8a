"""What a plan in a file says to an export: which EDF it was made from, and where its robots are. Reads no robot."""

from __future__ import annotations

import os
from collections.abc import Iterator
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.controller.plan_proof import provers
from srprov.controller.robot_files import is_record_path
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import DefinitionError, UsageError
from srprov.modules.file import FileParams
from srprov.network.record import read_record
from srprov.secret import redact
from srprov.untrusted import mapping, parse_json
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Map

if TYPE_CHECKING:
    from srprov.definitions.model import Inventory
    from srprov.facts.model import Snapshot
    from srprov.planning.planfile import PlanFile


def edf_of(plan: PlanFile, file: str) -> str:
    """Return the EDF that a plan was made from: beside the plan, or here, or where it was when this controller planned.

    A plan may come from a stranger. So no path in it is followed, and a file has the plan's own text before it is read
    as an EDF: what is wrong with one is shown with its lines, and what lies beside it is copied.

    Raises:
        UsageError: It is at none of these places, or has changed since.
    """
    names = [name for name, text in plan.inputs.items() if "/" not in name and _is_edf(name, text)]
    if not names:
        raise UsageError(f"{file} was made from no EDF", hint="name an EDF, or a plan of one", code=Code.PLAN_MISFIT)
    places = [os.path.join(os.path.dirname(file), names[0]), names[0], *(one.edf for one in provers(plan))]
    for path in filter(os.path.isfile, places):
        _check_text(plan, names[0], loader.read_text(path), file)
        return path
    raise UsageError(
        f"the EDF of this plan, {names[0]}, is not there", hint="put the plan beside its EDF", code=Code.PLAN_MISFIT
    )


def _is_edf(name: str, text: str) -> bool:
    """Return whether a text is an EDF; others beside it are CDFs, Dockerfiles and playbooks."""
    try:
        root = loader.parse(text, name)
    except DefinitionError:
        return False
    return isinstance(root, Map) and "edf" in root.entries


def check_same(plan: PlanFile, found: Definitions, file: str) -> None:
    """Refuse definitions that are not those of the plan.

    Raises:
        UsageError: Names the first file that differs.
    """
    experiment = found.experiment
    now = {experiment.file: experiment.text, **{path: one.text for path, one in found.containers.items()}}
    texts = {os.path.relpath(path, experiment.folder): text for path, text in now.items()}
    for name, text in sorted(texts.items()):
        if name in plan.inputs:
            _check_text(plan, name, text, file)


def _check_text(plan: PlanFile, name: str, text: str, file: str) -> None:
    if redact(text) != plan.inputs[name]:
        raise UsageError(
            f"{name} has changed since {Path(file).name} was made",
            hint="plan again, or export the EDF",
            code=Code.PLAN_MISFIT,
        )


def check_pins(plan: PlanFile, experiment: Experiment) -> None:
    """Refuse a plan that places a service elsewhere than where its EDF has it: whoever has that robot has its secrets.

    Raises:
        UsageError: Names the first one.
    """
    for name, robot in sorted(plan.plan.assignment.items()):
        if (pin := experiment.services[name].robot) not in ("", robot):
            raise UsageError(
                f"the plan places {name} on {robot}, and its EDF has it on {pin}",
                hint="plan again, or export the EDF",
                code=Code.PLAN_MISFIT,
            )


def told_of_placement(plan: PlanFile, placed: Experiment, whole: Experiment) -> Iterator[str]:
    """Yield what is said of who runs what, where that is only the word of a plan that was not written here.

    `placed` has the instances that it places, `whole` is the experiment as it was read.
    """
    if is_of_here(plan):
        return
    every, whose = sorted(plan.plan.assignment.items()), "by the word of the plan, which was not written here"
    for robot in sorted({one for _, one in every}):
        yield f"{robot} runs {', '.join(name for name, one in every if one == robot)} {whose}"
    there = {one.instance_of or name for name, one in placed.services.items()}
    if gone := sorted(name for name, one in whole.services.items() if name not in there and not one.profiles):
        yield f"no robot runs {', '.join(gone)} {whose}"


def is_of_here(plan: PlanFile) -> bool:
    """Return whether this controller wrote a plan: only then counts what it says of where robots are."""
    return bool(provers(plan))


def underlays(snapshot: Snapshot) -> dict[str, str]:
    """Return robot -> the address that others reach, as robots themselves say."""
    return {name: facts.underlay_address for name, facts in snapshot.facts.items()}


def told_of_addresses(snapshot: Snapshot, inventory: Inventory, file: str) -> dict[str, str]:
    """Return robot -> what is said of its address, where only stored facts say it: others are told to reach it there.

    They may be a stranger's, and services send there what they have for each other, secrets too.
    """
    found = {}
    for name, address in underlays(snapshot).items():
        host = inventory.hosts[name]
        own = {_plain(host.address), _plain((host.underlay or "").partition("/")[0])} - {""}
        if address and _plain(address) not in own:
            beside = f"; the inventory has {', '.join(sorted(own))}" if own else ""
            found[name] = f"{name} is at {address} for services on other robots, as {file} says{beside}"
    return found


def _plain(address: str) -> str:
    try:
        return str(ip_address(address.partition("%")[0]))
    except ValueError:  # a name, or an interface
        return ""


def addresses_of(plan: PlanFile) -> dict[str, str]:
    """Return robot -> the address that others reach, from the placement record that the plan writes.

    Nothing of a plan that was not written here: services would be told of a stranger's host as one of the others.
    """
    if not is_of_here(plan):
        return {}
    wants = (*(step.want for step in plan.plan.steps if step.want), *plan.also_wanted)
    for want in wants:
        if isinstance(want.params, FileParams) and is_record_path(want.name):
            try:
                record = read_record(mapping(parse_json(want.params.text)))
            except ValueError:
                continue
            if record:
                return dict(record.vteps)
    return {}
