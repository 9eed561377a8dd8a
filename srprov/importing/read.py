"""Compose files -> one normal project, or everything that is wrong with them.

Takes paths and the user's choices; gives a `Normal`. Reads the files and what they name in the same folders.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.compose import consistency, envfiles, finish, notes
from srprov.importing.compose.loading import File, Loading
from srprov.importing.compose.origins import Origin
from srprov.importing.compose.printing import printed
from srprov.importing.compose.project import load
from srprov.importing.compose.service_env import with_env_files
from srprov.importing.compose.source import Reading
from srprov.importing.compose.values import Value, places, plain
from srprov.importing.compose.variables import Variables
from srprov.importing.normal import Normal, Refused
from srprov.importing.position import Position
from srprov.yamldoc.allowance import allowance

MOST_BYTES = 8 * 1024 * 1024
MOST_VALUES = 40_000
"""Of all files of a project together; large published ones have a tenth."""
_NAME = re.compile("[a-z0-9][a-z0-9_-]*")


def normalise(
    files: Sequence[Path],
    *,
    profiles: Sequence[str] = (),
    env_files: Sequence[Path] = (),
    settings: Mapping[str, str] | None = None,
    project: str | None = None,
    own: Collection[str] = (),
    root: str = "",
) -> Normal:
    """Read a Compose project as Docker Compose would, but for the environment, which is never looked at.

    Args:
        files: Compose files, at least one; later ones override earlier ones. Relative paths in all of them begin at
            the folder of the first.
        profiles: Names of the profiles that are on; `*` is all of them.
        env_files: Files with variables; without any, `.env` beside the first file, for what lies there.
        settings: Variables of the command line; they win over those of files.
        project: The project's name; without it, `COMPOSE_PROJECT_NAME` of the variables, `name:` of the files, or the
            name of the first file's folder.
        own: Real paths of files of the user's that are read for no file's sake.
        root: Real path of the folder of the whole project, in which all Compose files lie; without it, they lie in
            that of the first one, also those that one of them names. Each names what lies there, and nothing else.

    Raises:
        Refused: With every problem that was found, each with its place.
    """
    with allowance(MOST_BYTES, MOST_VALUES):
        named = [File(str(file), str(file)) for file in files]
        reading = Reading(root or os.path.dirname(os.path.realpath(named[0].path)), bool(root), frozenset(own))
        return _normalise(named, reading, profiles, env_files, settings or {}, project)


def _normalise(
    files: Sequence[File],
    reading: Reading,
    profiles: Sequence[str],
    env_files: Sequence[Path],
    settings: Mapping[str, str],
    project: str | None,
) -> Normal:
    folder = os.path.dirname(os.path.realpath(files[0].path))
    given = {name: Origin(value, "--set") for name, value in settings.items()}
    variables = Variables(given)
    named = [File(str(path), str(path)) for path in env_files] or _own_env_file(folder, files[0])
    variables = variables.beside(envfiles.variables(named, reading, variables))
    name = _project_name(project, files, reading, variables)
    variables = variables.beside({"COMPOSE_PROJECT_NAME": Origin(name, "project")})
    loading = Loading(reading, variables, folder, list(notes.of_command(files, folder)))
    tree = load(files, loading)
    tree = finish.implied(tree, name, variables)
    everything = printed(tree.of({**tree.data, "name": Value(name, tree.place)}), "project")
    on = profiles or [one for one in _worth(variables, "COMPOSE_PROFILES").split(",") if one]
    tree = finish.chosen(everything, on)
    consistency.consistent(tree, everything)
    tree = finish.used_only(with_env_files(tree, loading, files[0]))
    return _result(tree, loading)


def _result(tree: Value, loading: Loading) -> Normal:
    if loading.variables.problems:
        raise Refused(loading.variables.problems)
    said = [*loading.notes, *notes.of_project(tree, loading.reading.written)]
    used = dict.fromkeys(loading.variables.used)
    told = tuple(dict.fromkeys(said))
    reading = loading.reading
    named = tuple(dict.fromkeys(reading.named))
    return Normal(
        document=plain(tree),
        positions=dict(places(tree)),
        variables=tuple(used),
        warnings=told,
        secret_files=frozenset(reading.secrets),
        named_files=named,
        home=reading.home,
    )


def _own_env_file(folder: str, first: File) -> list[File]:
    path = os.path.join(folder, ".env")
    if not os.path.lexists(path) or os.path.isdir(path):
        return []
    shown_as = os.path.join(os.path.dirname(first.shown), ".env")
    return [File(path, shown_as, Value(".env", Position(first.shown)))]


def _worth(variables: Variables, name: str) -> str:
    origin = variables.worth.get(name)
    return origin.value if origin else ""


def _project_name(given: str | None, files: Sequence[File], reading: Reading, variables: Variables) -> str:
    """Return the project's name; what `name:` of a file says loses what it may not have."""
    if chosen := given or _worth(variables, "COMPOSE_PROJECT_NAME"):
        if not _NAME.fullmatch(chosen):
            message = f"'{chosen[:60]}' is no name of a project: lower-case letters, digits, '_' and '-'"
            raise Refused([Diagnostic(Position(files[0].shown), message, code=Code.COMPOSE)])
        return chosen
    written = _written_name(files, reading, variables)
    tidy = _tidy(written) or _tidy(os.path.basename(os.path.dirname(os.path.abspath(files[0].path))))
    if not tidy:
        message = "the project has no name"
        raise Refused(
            [Diagnostic(Position(files[0].shown), message, hint="write `name:` into the file", code=Code.COMPOSE)]
        )
    return tidy


def _written_name(files: Sequence[File], reading: Reading, variables: Variables) -> str:
    """Return what the last `name:` of the files says."""
    written = ""
    for file in files:
        tree = reading.tree(file.path, file.shown, file.named)
        name = tree.get("name")
        if name is not None and isinstance(name.data, str) and name.data:
            written = dataclasses.replace(variables, used=[]).put_in(name.data, name.at)
            if variables.problems:
                raise Refused(variables.problems)
    return written


def _tidy(name: str) -> str:
    return re.sub("[^a-z0-9_-]", "", name.lower()).lstrip("_-")
