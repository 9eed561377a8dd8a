"""Whose word an inventory is that no command line names: the user's own, or a project's, which may be a stranger's."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from srprov.cli.config import ConfigFile, files, places, read_table, set_for
from srprov.cli.standing import are_names, leads_anywhere, stand


def unnamed_inventories(context: click.Context | None, paths: Collection[str]) -> list[str]:
    """Return those of an inventory that the user did not name himself: paths that lead anywhere, a project's names.

    Robots by name are the same ones in whatever folder this is, where his own configuration has them, or a variable.
    """
    found = [one for one in paths if leads_anywhere(context, "inventories", one)]
    if context is None or not any(map(are_names, found)):
        return found
    if context.get_parameter_source("inventories") is ParameterSource.DEFAULT_MAP:
        having, verbs, verb = _having_inventory(context)
        if not (having[-1][0].own or is_of(having[0][0], verbs, verb, paths)):
            return found
    return [one for one in found if not are_names(one)]


def inventory_set_aside(context: click.Context, paths: tuple[str, ...]) -> str:
    """Return where a project's file names an inventory that gives way to the user's own, as `FILE:LINE`, or nothing.

    `paths` are what is read; a verb may read another one than was given to it, such as that of its own lab.
    """
    source = context.get_parameter_source("inventories")
    if source is not ParameterSource.DEFAULT_MAP or context.params.get("inventories") != paths:
        return ""
    having, verbs, verb = _having_inventory(context)
    aside = [f"{file.path}:{line}" for file, line in having if not file.own]
    return aside[-1] if aside and is_of(having[0][0], verbs, verb, paths) else ""


def is_of(file: ConfigFile, verbs: Mapping[str, Any], verb: str, paths: Collection[str]) -> bool:
    """Return whether an inventory in use is what the user's own file says, to which a project's gives way.

    It is not enough that these stand: a project's file may have robots by name, and the user's a relative path.
    """
    if not (file.own and stand(paths)):
        return False
    return list(paths) == set_for(verb, read_table(file, verbs)[0], file).get("inventories")


def verbs_of(context: click.Context) -> Mapping[str, Any]:
    """Return all verbs, as keys."""
    root = context.find_root()
    return dict.fromkeys(root.command.list_commands(root) if isinstance(root.command, click.Group) else (), "")


def _having_inventory(context: click.Context) -> tuple[list[tuple[ConfigFile, int]], Mapping[str, Any], str]:
    """Return the files that name an inventory for this verb, from weak to strong, and the line; all verbs; this one."""
    verbs, verb = verbs_of(context), context.command_path.split()[1]
    found = [(file, places(verbs, file).get((verb, "inventories"))) for file in files(Path.cwd(), os.environ)]
    return [(file, line) for file, line in found if line is not None], verbs, verb
