"""Paths that hold in whatever folder this is: of a configuration, or of a variable that a shell's profile sets.

A relative one may name a file of a project that was cloned, so it says nothing that is believed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from srprov.codes import Code
from srprov.errors import UsageError

_F = TypeVar("_F", bound=Callable[..., Any])


def leads_anywhere(context: click.Context | None, parameter: str, path: str) -> bool:
    """Return whether a path is relative, and comes from a configuration or a variable and not from the command line."""
    source = context.get_parameter_source(parameter) if context else None
    return source in (ParameterSource.DEFAULT_MAP, ParameterSource.ENVIRONMENT) and not os.path.isabs(path)


def stand(paths: Collection[str]) -> bool:
    """Return whether these are whole paths, or robots by name, and not names that mean other files in other folders.

    A file that is called as such names is never read for them.
    """
    return bool(paths) and all(os.path.isabs(one) or are_names(one) for one in paths)


def are_names(path: str) -> bool:
    """Return whether these are robots by name."""
    return "," in path and "/" not in path


def signers_option(told: str) -> Callable[[_F], _F]:
    """Return the option that names whose signatures count."""
    kind = click.Path(exists=True, dir_okay=False)
    return click.option("--signers", type=kind, default=None, metavar="FILE", callback=_believed, help=told)


def _believed(context: click.Context, option: click.Parameter, path: str | None) -> str | None:
    """Refuse a file of signers that may be a stranger's."""
    if path is not None and leads_anywhere(context, str(option.name), path):
        message = f"'{path}', of a configuration or a variable, would be looked for in whatever folder this is"
        raise UsageError(message, hint="write its whole path there", code=Code.OPTION_VALUE)
    return path
