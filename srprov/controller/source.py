"""What a run starts from: an experiment's definitions, or a plan that was kept in a file. Reads the files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions

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
        text = Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None  # the definitions say what is wrong with it
    if not text.lstrip().startswith("{"):
        return None
    from srprov.planning.planfile import is_plan, load

    return load(text, file) if is_plan(text) else None


def named_instance(file: str) -> tuple[str, str]:
    """Return an experiment's name and its source; the EDF need not be valid any more for that.

    Raises:
        DefinitionError: It has no name that can be read.
    """
    from srprov.definitions.named import experiment_name
    from srprov.definitions.source import source_of

    return experiment_name(file), source_of(str(Path(file).resolve()))
