"""The values of secrets, read only where the user allowed it.

Takes what a run starts from, an experiment or a plan from a file; gives a Vault. Remembers which files are secrets',
then reads variables, files and the output of programs of the controller: see `own_files`. The vault goes into wanted
resources, for their hashes (`with_value`), and into sessions, which write the values.

What a plan file names is read after the user saw the plan and said yes: `HeldSecrets`.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import TYPE_CHECKING

from msgspec.structs import replace

from srprov.controller.own_files import has_names_elsewhere
from srprov.controller.permissions import permit_planning
from srprov.definitions.model import Definitions
from srprov.definitions.secrets import files_of
from srprov.definitions.secretvalues import resolve, used
from srprov.definitions.taken import ANYBODY, in_words
from srprov.planning.policy import Permission, permissions
from srprov.record.memory import note_secret_files
from srprov.secret import Vault

if TYPE_CHECKING:
    from srprov.controller.plan import Planned
    from srprov.definitions.secretmodel import SecretSource
    from srprov.planning.plan import Plan
    from srprov.planning.planfile import PlanFile


def read_secrets(source: Definitions, allowed: Collection[str]) -> Vault:
    """Read the values that a run will write, before anything else is started that could inherit a variable.

    Raises:
        RefusedError: The user did not allow it: an EDF could name any variable, file or program of the controller.
        DefinitionError: With every variable, file and command that gave no value.
        UsageError: As `note_secret_files`.
    """
    if source.unsupported:
        return Vault()  # refused as soon as a plan is made, with all that is not built
    permit_planning(permissions(source.experiment, source.containers), allowed)
    wanted = used(source.experiment)
    _note(wanted)
    return resolve(wanted)


class HeldSecrets:
    """The secrets of a run: of an EDF read at once, of a plan file allowed at once and read in the end.

    A plan file's variables leave the environment at once, so that no program that srprov starts inherits one.
    """

    def __init__(self, source: Definitions | PlanFile, allowed: Collection[str]) -> None:
        """Refuse what the user did not allow; see `read_secrets`."""
        self._variables: dict[str, str] | None = None
        if isinstance(source, Definitions):
            self.vault = read_secrets(source, allowed)
            return
        permit_planning([*source.plan.permissions, *_of_elsewhere(source.plan)], allowed)
        self.vault = Vault()
        names = {one.env for one in secret_sources(source.plan) if one.env}
        self._variables = {name: os.environ.pop(name) for name in sorted(names) if name in os.environ}

    def read(self, planned: Planned) -> Planned:
        """Read the values that the steps of a plan from a file write, and return it with them.

        Raises:
            DefinitionError: With every variable, file and command that gave no value.
            UsageError: As `note_secret_files`.
        """
        if self._variables is None:
            return planned
        from srprov.modules.secret import with_value

        sources = secret_sources(planned.plan)
        _note(sources)
        self.vault.fill(resolve(sources, {**os.environ, **self._variables}))
        steps = tuple(
            replace(step, want=with_value(step.want, self.vault)) if step.want else step for step in planned.plan.steps
        )
        return replace(planned, plan=replace(planned.plan, steps=steps))


def note_named(file: str, allowed: Collection[str]) -> None:
    """Remember what an EDF calls files of secrets, where its user allows secrets, before anything else of it is read.

    They stay so, whatever comes of that: whoever writes the EDF can have it fail, by a mistake, or by what its user
    does not allow, and call a file that lies there something else in the next version.

    Raises:
        UsageError: As `note_secret_files`.
    """
    if not {"secret", "all"}.isdisjoint(allowed):
        note_secret_files(files_of(file))


def _note(sources: Collection[SecretSource]) -> None:
    """Remember files as those of secrets, before any value is read."""
    note_secret_files({os.path.realpath(one.file) for one in sources if one.file})


def _of_elsewhere(plan: Plan) -> list[Permission]:
    """Return what a plan file does not say of the files of its secrets: one may have its name from an archive."""
    files = {one.file for one in secret_sources(plan) if one.file}
    return [
        Permission(kind="outside", service=ANYBODY, what=in_words(one))
        for one in sorted(files)
        if has_names_elsewhere(one)
    ]


def secret_sources(plan: Plan) -> tuple[SecretSource, ...]:
    """Return the sources of the secrets that a plan's steps write."""
    from srprov.modules.secret import names_of

    written = names_of(step.want for step in plan.steps if step.want)
    return tuple(source for source in plan.secrets if source.name in written)
