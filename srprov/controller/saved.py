"""Plans that are kept: from what was planned to a file, and back to a plan that may be applied.

Reads the definition files, and asks robots what moved; changes nothing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from msgspec.structs import replace

import srprov
from srprov.codes import Code
from srprov.controller import authority
from srprov.controller.authority import check_copies, services_of, wants_of
from srprov.controller.data_owner import check_saved, refuse_labels, remember_owner
from srprov.controller.data_sets import refuse_files
from srprov.controller.fleet import Fleet
from srprov.controller.image_builders import check_builders, counted, proofs_of
from srprov.controller.old_values import as_reviewed, with_differences, without_old_lines
from srprov.controller.overlay_claim import check_underlay
from srprov.controller.overlay_notes import notes_of_a_plan_from_elsewhere
from srprov.controller.ownership import check_source, looking, makers_of, owned
from srprov.controller.permissions import require_decided
from srprov.controller.plan import Planned
from srprov.controller.plan_proof import check_claim, proved, provers
from srprov.controller.robot_room import check_room
from srprov.controller.robots_notes import notes_of_robots
from srprov.controller.staleness import refuse_stale, refuse_unnoted
from srprov.controller.writers import check_writers
from srprov.definitions.model import BUILDERS, Inventory, NetworkSettings
from srprov.errors import UsageError
from srprov.facts.gather import Detail, Gathering
from srprov.facts.model import Snapshot
from srprov.modules import PROBING
from srprov.modules.network import NetworkParams
from srprov.modules.secret import SecretParams
from srprov.names import few
from srprov.network.identity import check_names, identify
from srprov.network.record import read_record
from srprov.planning.diff import diff
from srprov.planning.fingerprint import fingerprints, relied_on
from srprov.planning.limit import limited
from srprov.planning.plan import Plan, Step
from srprov.planning.planfile import PlanFile, differences, step_out
from srprov.planning.planread import named
from srprov.planning.target import targeted
from srprov.record.memory import known_images
from srprov.resource import Resource
from srprov.secret import redact

_SHOWN = 8


def plan_file(planned: Planned) -> PlanFile:
    """Return what `plan -o` writes and a run records: the plan, its inputs, and what it relies on.

    The inventory is not among the inputs: it may hold passwords.
    """
    if planned.saved:
        return replace(planned.saved, plan=planned.plan)
    assert planned.snapshot is not None  # only a plan from a file has none
    plan = planned.plan
    stepped = {step.id for step in plan.steps if step.want}
    hosts = relied_on(planned.whole or plan) | {one.host for one in planned.desired}
    also = sorted((one for one in planned.desired if one.id not in stepped), key=lambda one: one.id)
    saved = PlanFile(
        plan=plan,
        fingerprints=fingerprints(planned.whole or plan, planned.snapshot, also, hosts),
        also_wanted=tuple(also),
        contexts={tag: image.context for tag, image in planned.images.items()},
        limit=planned.limit,
        targets=planned.targets,
        inputs=_inputs(planned),
        made_by=srprov.__version__,
    )
    # whoever applies the file has only its resources to judge by
    more = [one for one in authority.asked(saved) if one not in plan.permissions]
    return replace(saved, plan=replace(plan, permissions=(*plan.permissions, *dict.fromkeys(more))))


def kept_plan(planned: Planned) -> PlanFile:
    """Return the plan for a file, with the proof that it was written here, and write down who owns the instance.

    Raises:
        RefusedError: It would leave data behind, and the user has not said so.
        UsageError: Who owns the volumes cannot be written down.
    """
    require_decided(planned.plan.data)
    remember_owner(planned.plan, planned.owner)
    saved = plan_file(planned)
    # as they are written: the proof is about the file
    inputs = {name: redact(text) for name, text in saved.inputs.items()}
    return proved(replace(saved, inputs=inputs), planned.owner)


def _inputs(planned: Planned) -> dict[str, str]:
    """Return name -> text of the definition files; a removal has none."""
    if planned.definitions is None:
        return {}
    experiment, containers = planned.definitions.experiment, planned.definitions.containers
    # as they were read and rendered: the record says what ran, not what lies there by now
    texts = {experiment.file: experiment.text, **{path: one.text for path, one in containers.items()}}
    texts |= {one.file: one.text for one in planned.playbooks}
    return {os.path.relpath(path, experiment.folder): text for path, text in sorted(texts.items())}


def check_plan(saved: PlanFile, fleet: Fleet, *, adopt: bool = False, signed: bool = False) -> Planned:
    """Return the plan of a file when nothing that it relies on has moved; robots out of reach are noted in it.

    Its steps are those that follow from what it wants and from the robots as they are now; what the file says of them
    must be the same. The values of secrets are not known yet. `signed` says that somebody whom the user trusts
    signed the file.

    Raises:
        StalePlan: Names what moved on which robot.
        UsageError: A robot of the plan is not in the inventory; or the file's steps are not those that follow.
        RefusedError: Another source made the instance, and `adopt` does not take it over; or the file was not written
            here, and would change what is there, use data, or send packets to a robot out of reach.
    """
    if missing := sorted(saved.fingerprints.keys() - fleet.inventory.hosts.keys()):
        why = f"the plan is for robots that are not in the inventory: {', '.join(missing)}"
        hint = "use the inventory that the plan was made with, or plan again"
        raise UsageError(why, hint=hint, code=Code.PLAN_MISFIT)
    owners = provers(saved)
    unknown = not (owners or signed)  # who wrote it may leave out a robot that has the instance
    asked = [name for name in fleet.inventory.hosts if unknown or name in saved.fingerprints]
    part = replace(fleet.inventory, hosts={name: fleet.inventory.hosts[name] for name in asked})
    wants = wants_of(saved)
    with Gathering(part, fleet.sessions.get, engine=True, forks=fleet.forks) as look:
        snapshot = look.probe(look.closer(Detail.ENGINE), wants)
        refuse_stale(saved, wants, snapshot, look)
        check_saved(saved.plan, wants, snapshot, owners)
        believed = looking(snapshot, saved.plan.instance).snapshot
        check_source(believed, saved.plan.instance, saved.plan.source, adopt=adopt)
        if not owners:
            _check_elsewhere(saved, fleet.inventory, snapshot, look, adopt=adopt, signed=signed)
        _check_networks(wants, saved.plan.instance, believed)
        check_room(wants, snapshot, saved.plan.instance)
        derived = _derived(saved, wants, snapshot, look, ours=bool(owners))
        check_writers(derived.steps, [(want.host, one) for want, one in services_of(saved)], look)
        plan = _as_found(saved, derived, snapshot, look, ours=bool(owners))
    return Planned(plan=plan, saved=saved, makers=makers_of(snapshot, plan.instance, plan.source))


def _check_elsewhere(
    saved: PlanFile, inventory: Inventory, snapshot: Snapshot, look: Gathering, *, adopt: bool, signed: bool
) -> None:  # fmt: skip
    """Refuse what only a file that was not written here says."""
    wants, builders = wants_of(saved), inventory.groups.get(BUILDERS, ())
    ours = counted(known_images(), {want.name for want in wants}, builders, snapshot, proofs_of(look, snapshot))
    check_copies(saved, ours, snapshot.facts)
    refuse_files(wants)
    refuse_labels(wants, trusted=adopt or signed)
    check_underlay(saved, wants, {robot: facts.underlay_address for robot, facts in snapshot.facts.items()})
    if not signed:
        check_builders([step.want for step in saved.plan.steps if step.want], inventory, snapshot)
        check_claim(saved, snapshot, adopt=adopt)


def _as_found(
    saved: PlanFile, derived: Plan, snapshot: Snapshot, look: Gathering, *, ours: bool
) -> Plan:  # fmt: skip
    """Return a file's plan with its steps as they were derived, what robots say, and what a stranger's file may hide.

    Raises:
        StalePlan: They say what a file that was written here (`ours`) does not tell.
    """
    plan, steps = saved.plan, derived.steps
    noted, leads = notes_of_robots(steps, snapshot, look, plan.instance)
    if ours:
        refuse_unnoted(saved, noted)
    else:
        noted = (*noted, *notes_of_a_plan_from_elsewhere(plan.instance, steps))
    silent = {name: why for name, why in snapshot.unreachable.items() if name in saved.fingerprints}
    if others := sorted(snapshot.unreachable.keys() - silent.keys()):
        noted = (*noted, f"robots that do not answer may have something of its instance: {few(others, _SHOWN)}")
    away = {name: why for name, why in plan.unreachable.items() if name not in snapshot.facts} | silent
    notes = tuple(dict.fromkeys((*plan.notes, *noted, *derived.notes)))
    return replace(plan, steps=steps, unchanged=derived.unchanged, notes=notes, unreachable=away, leads=leads)


def _check_networks(wants: tuple[Resource, ...], instance: str, believed: Snapshot) -> None:
    """Hold the overlay of a plan file to what an EDF's is held to: nothing on a robot may have its subnet or VNI.

    Nor may its names be another instance's, which a tunnel has also where there is no network.
    """
    check_names(instance, believed)
    record = read_record(believed.placements.get(instance))
    overlays = [want.params for want in wants if isinstance(want.params, NetworkParams)]
    members = {want.host for want in wants if isinstance(want.params, NetworkParams)}
    for subnet, vni, port in sorted({(one.subnet, one.vni, one.port) for one in overlays}):
        identify(instance, NetworkSettings(subnet=subnet, vni=vni, port=port), believed, record, members)


def _derived(saved: PlanFile, wants: tuple[Resource, ...], snapshot: Snapshot, look: Gathering, *, ours: bool) -> Plan:
    """Return the plan with the steps that follow from what a file wants, and as notes what its choice leaves out.

    Steps of robots out of reach have no commands.

    Only a file that was written here (`ours`) may hide the new content of a file, as one with a secret in it.
    """
    away = saved.fingerprints.keys() - snapshot.facts.keys()
    # whether a secret that is there is right shows only when its value is read, after the question
    there = {(host, one.module, one.name) for host, items in snapshot.observed.items() for one in items}
    secrets = [one for one in saved.also_wanted if isinstance(one.params, SecretParams)]
    settled = {one.id for one in secrets if (one.host, one.module, one.name) in there}
    settled |= {want.id for want in wants if want.host in away}
    beside = [step for step in saved.plan.steps if step.host in away]
    plan = saved.plan
    steps, unchanged = diff(wants, owned(snapshot, plan.instance), plan.instance, settled=settled, beside=beside)
    chosen = replace(plan, steps=steps, unchanged=unchanged, notes=())
    if saved.targets:
        chosen = targeted(chosen, wants, saved.targets)
    if saved.limit:
        chosen = limited(chosen, saved.limit)
    steps = chosen.steps
    filed = {step.number: step for step in plan.steps}
    live = with_differences(steps, snapshot.observed, wants, look, strange=not ours)
    reviewed = tuple(as_reviewed(step, filed.get(step.number)) for step in live)
    changed = differences(_by_number(plan.steps), _by_number(reviewed, filed))
    if changed:
        hint = "somebody changed it, or another version of srprov made it: plan again, review it again, apply that"
        raise UsageError(
            f"the plan's steps are not those that srprov derives from it:\n{named(changed)}",
            hint=hint,
            code=Code.PLAN_CHANGED,
        )
    steps = reviewed if ours else tuple(map(without_old_lines, reviewed, live))
    # nobody looked at what they would change
    mute = {step.number: replace(step.change, commands=()) for step in steps if step.host in away}
    return replace(chosen, steps=tuple(replace(one, change=mute.get(one.number, one.change)) for one in steps))


def _by_number(steps: tuple[Step, ...], filed: Mapping[int, Step] | None = None) -> Mapping[str, object]:
    """Return what two plans must agree on: all but causes that only a secret's value, or a check just now, tells.

    Of the steps of `filed` that tell no values, as in files of older versions, no other ones do.
    """
    told = {}
    for step in steps:
        silent = filed is not None and (other := filed.get(step.number)) is not None and not other.differences
        out = step_out(replace(step, differences=()) if silent else step, {})
        told[f"step {step.number}"] = {**out, "cause": "" if _varies(step) else step.change.cause}
    return {**told, "order": list(told)}


def _varies(step: Step) -> bool:
    return step.module in PROBING or (step.want is not None and isinstance(step.want.params, SecretParams))
