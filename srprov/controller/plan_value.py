"""All that was decided -> the plan as a value. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from srprov.assignment.model import Assignment
from srprov.controller.choice import idle_notes
from srprov.controller.copies import placement_notes
from srprov.controller.image_plans import moved_tags
from srprov.controller.render_inputs import RenderInputs
from srprov.controller.trial_values import design_notes
from srprov.definitions.model import Definitions
from srprov.definitions.playbookmodel import Playbook
from srprov.definitions.secretvalues import used
from srprov.planning.plan import Plan, PlaybookUse, Step
from srprov.planning.policy import permissions


def plan_value(
    definitions: Definitions, inputs: RenderInputs, placed: Assignment, theirs: Sequence[Playbook],
    steps: tuple[Step, ...], unchanged: int, notes: tuple[str, ...],
) -> Plan:  # fmt: skip
    """Return the plan, with what is worth knowing of how it came about."""
    experiment = inputs.experiment
    return Plan(
        instance=inputs.instance,
        source=inputs.source,
        steps=steps,
        unchanged=unchanged,
        assignment=placed.placed,
        cost=placed.cost,
        costs={service: terms.total for service, terms in placed.terms.items()},
        permissions=permissions(experiment, definitions.containers),
        secrets=used(experiment),
        data=inputs.data.moves,
        notes=(
            *definitions.notes,
            *moved_tags(definitions.locked, inputs.snapshot),
            *placement_notes(inputs, placed),
            *idle_notes(definitions, experiment, inputs.snapshot),
            *notes,
            *inputs.data.notes,
            *design_notes(definitions.experiment.trials),
        ),
        unreachable=inputs.snapshot.unreachable,
        playbooks=tuple(PlaybookUse(name=one.name, file=one.file, place=one.place) for one in theirs),
    )
