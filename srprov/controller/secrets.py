"""The values of secrets, read only where the user allowed it.

Takes what a run starts from, an experiment or a plan from a file; gives a Vault. Reads variables, files and the output
of programs of the controller. The vault goes into wanted resources, for their hashes (`with_value`), and into sessions,
which write the values.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from srprov.controller.permissions import permit_planning
from srprov.definitions.model import Definitions
from srprov.definitions.secretvalues import resolve, used
from srprov.planning.policy import permissions
from srprov.secret import Vault

if TYPE_CHECKING:
    from srprov.definitions.secretmodel import SecretSource
    from srprov.planning.planfile import PlanFile


def read_secrets(source: Definitions | PlanFile, allowed: Collection[str]) -> Vault:
    """Read the values that a run will write, before anything else is started that could inherit a variable.

    Raises:
        RefusedError: The user did not allow it: an EDF could name any variable, file or program of the controller.
        DefinitionError: With every variable, file and command that gave no value.
    """
    if not isinstance(source, Definitions):
        permit_planning(source.plan.permissions, allowed)
        return resolve(secret_sources(source))
    if source.unsupported:
        return Vault()  # refused as soon as a plan is made, with all that is not built
    permit_planning(permissions(source.experiment, source.containers), allowed)
    return resolve(used(source.experiment))


def secret_sources(saved: PlanFile) -> tuple[SecretSource, ...]:
    """Return the sources of the secrets that the plan's steps write."""
    from srprov.modules.secret import names_of

    written = names_of(step.want for step in saved.plan.steps if step.want)
    return tuple(source for source in saved.plan.secrets if source.name in written)
