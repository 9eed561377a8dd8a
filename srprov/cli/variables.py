"""The environment variable of each option: `SRPROV_<VERB>_<OPTION>`, as the option is called on the command line."""

from __future__ import annotations

import click


def variable_of(option: click.Option, prefix: str) -> str:
    """Return the name of an option's variable; `prefix` is `SRPROV_<VERB>`."""
    return f"{prefix}_{long_name(option)}".upper().replace("-", "_")


def long_name(option: click.Option) -> str:
    """Return an option's long name, without the dashes."""
    return max(option.opts, key=len).lstrip("-")


def name_variables(command: click.Command, prefix: str) -> None:
    """Let each option be set by its variable: click would look for the parameter's name in the code, and still does.

    An option that says itself which variable it has keeps that one, too.
    """
    for option in command.params:
        if isinstance(option, click.Option):
            own = [option.envvar] if isinstance(option.envvar, str) else list(option.envvar or ())
            option.envvar = list(dict.fromkeys((variable_of(option, prefix), *own)))
    for name, below in (command.commands if isinstance(command, click.Group) else {}).items():
        name_variables(below, f"{prefix}_{name}".upper().replace("-", "_"))
