"""What a run starts from: an experiment's definitions, or a plan that was kept in a file. Reads the files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from srprov import regular_file
from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.errors import UsageError

if TYPE_CHECKING:
    from srprov.planning.planfile import PlanFile


def read_source(file: str) -> Definitions | PlanFile:
    """Read an EDF with every file that it names, or a plan that `plan -o` wrote.

    Raises:
        DefinitionError: With everything that is wrong with it.
    """
    return _plan(file) or load_experiment(file)


def _plan(file: str) -> PlanFile | None:
    try:
        if not regular_file.beginning(file, 200).lstrip().startswith(b"{"):
            return None
    except OSError:
        return None  # the definitions say what is wrong with it
    from srprov.planning.planfile import MAX_CHARACTERS, is_plan, load

    try:
        text = regular_file.read_text(file, MAX_CHARACTERS)
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror}", hint="apply the EDF itself") from error
    return load(text, file) if is_plan(text) else None


def named_instance(file: str) -> tuple[str, str]:
    """Return an experiment's name and its source; the EDF need not be valid any more for that.

    Raises:
        DefinitionError: It has no name that can be read.
    """
    from srprov.definitions.named import experiment_name
    from srprov.definitions.source import source_of

    return experiment_name(file), source_of(str(Path(file).resolve()))
