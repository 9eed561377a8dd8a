"""Which files say what an experiment is: no copy from a container may take the place of one. Reads the definitions."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping

from srprov.definitions import load_experiment
from srprov.definitions.model import Definitions
from srprov.errors import DefinitionError


class _Every(Mapping[str, str]):
    """An environment that has every variable, and no value of anybody's: what an EDF is made from depends on none."""

    def __init__(self) -> None:
        self._word = secrets.token_hex(16)  # it counts as a value to be hidden, and stands nowhere

    def __getitem__(self, name: str) -> str:
        return self._word

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


def files_of(file: str) -> list[str]:
    """Return the files that an EDF is made from, itself among them; none where it is not valid: nobody knows then.

    A variable that it names need not be set: it often is for `apply` alone.
    """
    try:
        return made_from(load_experiment(file, _Every()))
    except DefinitionError:
        return []


def made_from(definitions: Definitions) -> list[str]:
    """Return the files that say what an experiment is: definitions, Dockerfiles, variables, secrets; not what it ships.

    What is shipped is what people bring from a robot.
    """
    experiment, containers = definitions.experiment, definitions.containers
    every = {*experiment.files, *containers, *(one.dockerfile for one in containers.values())}
    return sorted({*every, *(one.file for one in experiment.secrets.values())} - {""})
