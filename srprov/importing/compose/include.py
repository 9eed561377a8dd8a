"""Projects that a project includes: each has its own folder and its own `.env`. Reads files."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Sequence

from srprov.importing.compose import envfiles, paths
from srprov.importing.compose.loading import File, Loading
from srprov.importing.compose.values import Value, plain, refuse, text_list
from srprov.importing.compose.variables import Variables
from srprov.importing.position import Position

_KINDS = ("services", "volumes", "networks", "secrets", "configs", "models")
DEEPEST = 20
Load = Callable[[Sequence[File], Loading], Value]
"""Reads a project: that of this module's caller."""


def included(tree: Value, file: File, loading: Loading, load: Load) -> Value:
    """Return a file's tree with all that it includes; no two may give one name to different things.

    Raises:
        Refused: Files include one another in a circle, or one must not be read.
    """
    wishes = tree.get("include")
    if wishes is None:
        return tree
    result = tree.of({name: item for name, item in tree.data.items() if name != "include"})
    if wishes.data is None:
        return result
    if not isinstance(wishes.data, list):
        raise refuse(wishes, "include is a list", ("include",))
    below = _below(file, loading, wishes)
    for number, wish in enumerate(wishes.data):
        other = _project(wish, number, file, below, load)
        for kind in _KINDS:
            result = _with(result, other, kind)
    return result


def _below(file: File, loading: Loading, wishes: Value) -> Loading:
    if len(loading.open) >= DEEPEST:
        raise refuse(wishes, f"projects include one another more than {DEEPEST} deep", ("include",))
    return dataclasses.replace(loading, open=(*loading.open, os.path.realpath(file.path)))


def _with(result: Value, other: Value, kind: str) -> Value:
    theirs = other.get(kind)
    if theirs is None or not isinstance(theirs.data, dict):
        return result
    ours = result.get(kind)
    if ours is not None and not isinstance(ours.data, dict):
        raise refuse(ours, f"{kind} is a map", (kind,))
    entries = dict(ours.data) if ours is not None else {}
    for name, item in theirs.data.items():
        if name in entries and plain(entries[name]) != plain(item):
            message = f"{kind} '{name}' is there already, and what is included has another"
            raise refuse(entries[name], message, (kind, name), f"the other is at {item.place}")
        entries[name] = item
    return result.of({**result.data, kind: (ours or theirs).of(entries)})


def _project(wish: Value, number: int, file: File, loading: Loading, load: Load) -> Value:
    """Return the tree of one included project, with paths from this project's folder."""
    place = ("include", number)
    loading.reading.one_more(wish.at)
    if isinstance(wish.data, str):
        wish = wish.of({"path": Value(wish.data, wish.at)})
    if not isinstance(wish.data, dict):
        raise refuse(wish, "this is a path, or a map with a path", place)
    listed = wish.get("path")
    names = [] if listed is None else list(text_list(listed))
    if not names or not all(isinstance(name.data, str) for name in names):
        raise refuse(wish, "what is included has no path", place)
    files = [file.beside(loading.folder, name) for name in names]
    if os.path.realpath(files[0].path) in loading.open:
        raise refuse(names[0], f"files include one another in a circle: '{names[0].data}'", place)
    given = wish.get("project_directory")
    folder, reading = os.path.dirname(files[0].path), loading.reading
    for one, name in zip(files, names, strict=True):  # before any of them is read, or what lies beside it
        reading.beside(one.shown, one.path, name)
    if given is not None and isinstance(given.data, str):
        folder = os.path.join(loading.folder, given.data)
        reading.beside(f"what {file.beside(loading.folder, given).shown} holds", folder, given, folder=True)
    folder = os.path.normpath(folder)
    variables = _variables(wish, folder, file, loading)
    tree = load(files, loading.within(folder, variables))
    return paths.moved(tree, os.path.relpath(folder, loading.folder))


def _variables(wish: Value, folder: str, file: File, loading: Loading) -> Variables:
    """Return variables that also know those of the included project's own files."""
    given = wish.get("env_file")
    if given is not None:
        named = [file.beside(loading.folder, name) for name in text_list(given) if isinstance(name.data, str)]
    else:  # nobody named it: a link of that name leads no further than the project's files may
        first = file.beside(loading.folder, text_list(wish.data["path"])[0])
        one = file.beside(folder, Value(".env", Position(first.shown)))
        named = [one] if os.path.isfile(one.path) else []
    return loading.variables.beside(envfiles.variables(named, loading.reading, loading.variables))
