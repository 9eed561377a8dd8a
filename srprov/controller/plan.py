"""The plan: read, decide, lay out, render, compare. Nothing is changed here.

`make_plan` is the program in one list. It is pure, but for the look at the robots and the files of the definitions.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import replace

from srprov import rendering
from srprov.assignment import solve
from srprov.assignment.model import Assignment
from srprov.codes import Code
from srprov.controller import bundled
from srprov.controller.choice import Choice, choice_of, decided, settled
from srprov.controller.context import contexts
from srprov.controller.data_plan import plan_data
from srprov.controller.image_builders import counted, proofs_of
from srprov.controller.image_layers import with_layers
from srprov.controller.image_plans import images_alone, images_there, plan_images, with_fresh
from srprov.controller.labpolicy import enforce, with_limits
from srprov.controller.named_services import services_of
from srprov.controller.old_values import with_differences
from srprov.controller.overlay_notes import overlay_notes
from srprov.controller.own_files import asked_for
from srprov.controller.owners import Owner, with_bundle
from srprov.controller.ownership import check_source, makers_of, owned, trusting
from srprov.controller.permissions import permit_planning
from srprov.controller.phases import Phases
from srprov.controller.plan_value import plan_value
from srprov.controller.platforms import check_platforms
from srprov.controller.playbooks import playbooks
from srprov.controller.readiness import check_ready, with_log_drivers
from srprov.controller.render_inputs import RenderInputs
from srprov.controller.request import PlanRequest
from srprov.controller.robot_images import check_there
from srprov.controller.robot_room import check_room
from srprov.controller.robots_words import at_home
from srprov.controller.trial_values import at_first_point
from srprov.controller.writers import check_writers
from srprov.definitions.model import BUILDERS, Definitions, Experiment, Inventory
from srprov.definitions.pins import unknown_pins
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.source import source_of
from srprov.disk import together
from srprov.errors import DefinitionError, NoAssignment, TransportError
from srprov.facts.gather import Gathering
from srprov.facts.model import Snapshot
from srprov.modules import MODULES
from srprov.modules.secret import with_value
from srprov.network.layout import layout
from srprov.network.model import Overlay
from srprov.network.record import record
from srprov.planning.amiss import all_notes
from srprov.planning.diff import diff
from srprov.planning.limit import limited
from srprov.planning.plan import Plan, Step
from srprov.planning.policy import permissions
from srprov.record.memory import known_images
from srprov.resource import Resource
from srprov.secret import Vault

if TYPE_CHECKING:
    from srprov.images.plan import ImagePlan
    from srprov.planning.planfile import PlanFile


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """A plan with what led to it; how much that is depends on whether it was made, read from a file, or removes."""

    plan: Plan
    snapshot: Snapshot | None = None
    """The robots as they were; None for a plan from a file."""
    makers: frozenset[str] | None = None
    """Who had made the instance by then, as robots tell it, and its own source; None: it is about no instance."""
    definitions: Definitions | None = None
    experiment: Experiment | None = None
    """With every instance as a service of its own."""
    assignment: Assignment | None = None
    desired: tuple[Resource, ...] = ()
    """What should be true on all robots."""
    images: Mapping[str, ImagePlan] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Tag -> what is built under it; a failed build can name the line of the CDF."""
    unbuilt: frozenset[str] = frozenset()
    """CDFs of which no image was planned, as their services have those of a bundle."""
    playbooks: tuple[Playbook, ...] = ()
    """Those that users wrote, the experiment's and the user's own."""
    decided: Mapping[str, Any] | None = None
    """What else than files and facts led to the placement: `choice.decided`. None: it was not decided here."""
    owner: Owner | None = None
    """Who owns its volumes, with those that the run takes over; None: it makes none."""
    amiss: tuple[str, ...] = ()
    """Notes of the plan on what is not as it should be, and is left alone."""
    saved: PlanFile | None = None
    """The file that the plan was read from."""
    whole: Plan | None = None
    """The plan with the steps that were left out, if some were."""
    limit: tuple[str, ...] = ()
    """The robots whose steps were kept, if some were left out."""
    targets: tuple[str, ...] = ()
    """The services that were chosen, if steps on others were left out."""

    def limited(self, robots: Collection[str]) -> Planned:
        """Return it without the steps of other robots, and without those that need one of them."""
        plan = limited(self.plan, robots)
        whole = self.whole or self.plan
        return self if plan is self.plan else replace(self, plan=plan, whole=whole, limit=tuple(sorted(robots)))


def make_plan(
    definitions: Definitions, look: Gathering, request: PlanRequest, vault: Vault | None, phases: Phases | None = None
) -> Planned:
    """Read the robots and say what would make the experiment true.

    `look` has begun to ask them; `vault` has the secrets' values, or None; `phases` is the clock of the run.

    Raises:
        DefinitionError: The files name what was not fetched, or for robots that are not in the inventory.
        RefusedError: The instance belongs to another source, or asks for what the user or the lab does not allow.
        NoAssignment, UsageError, RenderError, PlanError: as their rooms say.
    """
    definitions, phases = _plannable(definitions, look.inventory, request), phases or Phases()
    place = source_of(definitions.experiment.file)
    instance, source = request.instance or definitions.experiment.name, with_bundle(place, request.owner)
    snapshot, notes = trusting(look.first(), instance, adopt=request.adopt)
    check_source(snapshot, instance, source, adopt=request.adopt)
    choice = choice_of(definitions, look.inventory, snapshot, instance, request)
    placed, choice = settled(choice, request.search_limit_s)
    if placed is None:
        snapshot, notes = trusting(look.closer(choice.detail), instance, adopt=request.adopt)
        choice = choice_of(definitions, look.inventory, snapshot, instance, request)
        phases.begin("assignment")
        placed = _solved(choice, snapshot, request)
    phases.begin("plan")
    choice = replace(choice, experiment=at_home(choice.experiment, placed.placed, snapshot.facts))
    overlay = layout(choice.experiment, placed.placed, snapshot, instance=instance, rotate=request.rotate_keys)
    theirs = (*choice.experiment.playbooks, *request.playbooks)
    with together():
        inputs = with_layers(_inputs(definitions, choice, placed, overlay, snapshot, source, request, look), look)
        snapshot, desired, steps, unchanged = _compared(inputs, theirs, vault, look)
    amiss, alone = ((), ()) if request.images_only else all_notes(desired, snapshot.observed)
    check_writers(steps, [(placed.placed.get(name, ""), one) for name, one in choice.experiment.services.items()], look)
    told, led = check_ready(steps, desired * request.trials, choice, instance, snapshot, look, playbooks=bool(theirs))
    notes = (*notes, *inputs.doubts, *amiss, *alone, *told, *overlay_notes(overlay, snapshot, choice.experiment))
    made = plan_value(definitions, replace(inputs, snapshot=snapshot), placed, theirs, steps, unchanged, notes)
    made = replace(made, chosen=any(choice.free or one in choice.new for one in placed.runner_up), leads=led)
    enforce(made, look.inventory, request.policies)
    return Planned(
        plan=made, snapshot=snapshot, definitions=definitions, experiment=choice.experiment, assignment=placed,
        desired=desired, images={image.tag: image for image in inputs.images.values()}, playbooks=theirs,
        owner=inputs.data.owner, amiss=amiss, decided=decided(choice, snapshot, instance, request),
        unbuilt=bundled.unbuilt(definitions.containers, inputs.experiment, inputs.bundled),
        makers=makers_of(look.first(), instance, source),  # whomever one believes
    )  # fmt: skip


def _solved(choice: Choice, snapshot: Snapshot, request: PlanRequest) -> Assignment:
    """Return who runs what; where no robot answered, that is why there is no placement.

    Raises:
        NoAssignment, TransportError, UsageError: There is none.
    """
    try:
        return solve.solve(choice.problem, request.search_limit_s)
    except NoAssignment:
        if snapshot.facts or not snapshot.unreachable:
            raise
        robot, why = min(snapshot.unreachable.items())
        message = f"no robot can be reached; {robot}: {why}"
        raise TransportError(robot, message, hint="srprov doctor says it of each", code=Code.NEEDED_ROBOT) from None


def _plannable(definitions: Definitions, inventory: Inventory, request: PlanRequest) -> Definitions:
    """Return the definitions with the limits of the lab's policy, at the first point of their parameters.

    What cannot or must not be planned is refused, before anything of it is shown to a robot.
    """
    if definitions.unsupported:
        raise DefinitionError(definitions.unsupported)
    if unknown := unknown_pins(definitions.experiment, inventory):
        raise DefinitionError(unknown)
    definitions = asked_for(definitions, inventory)
    permit_planning(permissions(definitions.experiment, definitions.containers), request.allowed)
    return at_first_point(with_limits(definitions, request.policies))


def _inputs(
    definitions: Definitions, choice: Choice, placed: Assignment, overlay: Overlay, snapshot: Snapshot, source: str,
    request: PlanRequest, look: Gathering,
) -> RenderInputs:  # fmt: skip
    mine, experiment = bundled.chosen(request.bundled, choice.experiment, placed.placed, snapshot.facts)
    definitions, experiment, doubts = with_fresh(
        definitions, experiment, placed.placed, snapshot.facts.keys(), look.ask_each, request.allowed
    )
    images, references = plan_images(bundled.to_build(definitions.containers, experiment, mine))
    builders, tags = look.inventory.groups.get(BUILDERS, ()), {one.tag for one in images.values()}
    inputs = RenderInputs(
        instance=overlay.instance,
        source=source,
        experiment=experiment,
        placed=placed.placed,
        overlay=overlay,
        images=images,
        references=references,
        record=record(overlay, experiment, placed.placed, source, snapshot.placements.get(overlay.instance)),
        snapshot=snapshot,
        data=plan_data(experiment, placed.placed, choice.data, snapshot, request),
        copy_way=request.copy,
        known_images=counted(known_images() if tags else {}, tags, builders, snapshot, proofs_of(look, snapshot)),
        images_only=request.images_only,
        images_for=services_of(request.targets, experiment, placed.placed) if request.images_only else (),
        bundled=mine,
        builders=builders,
        doubts=doubts,
    )
    check_there(inputs, seen=look.sees)
    check_platforms(inputs, definitions)
    return inputs


def _desired(inputs: RenderInputs, theirs: Sequence[Playbook], vault: Vault | None) -> tuple[Resource, ...]:
    """Return what should be true on all robots; only after rendering a secret gets its value."""
    per_robot, blobs = contexts(inputs)
    rendered = rendering.render_all(playbooks(), theirs, per_robot, modules=MODULES, blobs=blobs)
    wanted = images_alone(rendered) if inputs.images_only else rendered
    return tuple(wanted) if vault is None else tuple(with_value(resource, vault) for resource in wanted)


def _compared(
    inputs: RenderInputs, theirs: Sequence[Playbook], vault: Vault | None, look: Gathering
) -> tuple[Snapshot, tuple[Resource, ...], tuple[Step, ...], int]:
    """Return the robots as seen last, what should be true there, the steps to it, and how much is right already."""
    desired = _desired(inputs, theirs, vault)
    if inputs.images_only:
        steps, unchanged = diff(desired, images_there(inputs.snapshot), inputs.instance)
        return inputs.snapshot, desired, steps, unchanged
    check_room(desired, inputs.snapshot, inputs.instance)
    snapshot = look.probe(inputs.snapshot, desired)
    steps, unchanged = diff(desired, owned(snapshot, inputs.instance), inputs.instance)
    with_drivers = with_log_drivers(steps, snapshot, look)
    if with_drivers is not snapshot:
        # what an engine is asked for now changes how containers are made, and not which
        desired = _desired(replace(inputs, snapshot=with_drivers), theirs, vault)
        steps, unchanged = diff(desired, owned(with_drivers, inputs.instance), inputs.instance)
    return with_drivers, desired, with_differences(steps, with_drivers.observed, desired, look), unchanged
