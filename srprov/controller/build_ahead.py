"""`srprov build`: the part of an experiment's plan that brings images to robots, and nothing else of it.

The plan is made as `apply` makes it, with the same placement and permissions, and is done by the same run.
"""

from __future__ import annotations

from msgspec.structs import replace

from srprov.controller.phases import Phases
from srprov.controller.plan import Planned, make_plan
from srprov.controller.request import PlanRequest
from srprov.definitions.model import Definitions
from srprov.facts.gather import Gathering
from srprov.secret import Vault


def make_build(definitions: Definitions, look: Gathering, request: PlanRequest, phases: Phases) -> Planned:
    """Say what would bring the images of an experiment to the robots that it would be placed on.

    No secret is read, and nothing of it is in the plan: neither data, nor who owns it, nor costs, which no robot has
    by a build and which the next placement would even out.

    Raises:
        SrprovError: As `srprov.controller.plan.make_plan`.
    """
    planned = make_plan(definitions, look, replace(request, images_only=True), Vault(), phases)
    plan = replace(planned.plan, costs={}, secrets=(), data=())
    return replace(planned, plan=plan, assignment=None, owner=None)
