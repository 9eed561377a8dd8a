"""Files that a user names for an import: where a name lies, what it leads to must lie too. Looks at the file system.

A project may come from a stranger, who decides what a name in it leads to. Lines of the files are shown where something
is wrong with them, and what lies beside them is copied into the experiment.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from shlex import quote

from srprov.codes import Code
from srprov.definitions.homes import homes_in
from srprov.definitions.paths import inside, link_out
from srprov.definitions.version_control import is_kept
from srprov.errors import Diagnostic
from srprov.importing.compose.folders import apart
from srprov.importing.normal import Refused
from srprov.importing.position import Position


def check_root(folder: str, files: Sequence[str]) -> None:
    """Refuse a folder for a whole project that a link leads to elsewhere, that holds the user's home, or not all files.

    Raises:
        Refused: It is one.
    """
    if homes_in(folder):
        message, hint = "it is your home, or holds it", "put the project into a folder of its own"
    elif link_out(folder):
        message = "it leads out of the folder in which it is named"
        hint = f"if you mean what it leads to, name that: {quote(os.path.realpath(folder))}"
    elif out := [one for one in files if not inside(one, folder)]:
        message, hint = f"{out[0]} does not lie in it", "name a folder that is around all of the files"
    else:
        return
    raise Refused([Diagnostic(Position(folder), message, hint=hint, code=Code.OUTSIDE)])


def check_together(files: Sequence[str]) -> None:
    """Refuse Compose files that lie in folders apart, where the user did not say which folder is the whole project's.

    Raises:
        Refused: Names the first that lies in another folder than the one that is named first.
    """
    folders = [os.path.dirname(os.path.realpath(one)) for one in files]
    if other := next((one for one, folder in zip(files, folders, strict=True) if folder != folders[0]), ""):
        raise apart(other, files[0], folders, Position(other))


def check_named(files: Sequence[str]) -> None:
    """Refuse files that links lead out of the folder in which they are named, or that lie in the user's home.

    Of several files, that is the outermost folder of one that also holds the other by its name: a link to a folder in
    a project leads out of it as well. No link in a relative path leaves its own folder, whatever other files there are.

    Raises:
        Refused: One of them is such a file.
    """
    for one in files:
        if homes_in(os.path.dirname(os.path.abspath(one))):
            message, hint = "it lies in your home, of which it may name any file", "put it into a folder of its own"
            raise Refused([Diagnostic(Position(one), message, hint=hint, code=Code.OUTSIDE)])
    folders = sorted({os.path.dirname(os.path.abspath(one)) for one in files}, key=len)
    for one in files:
        path = os.path.abspath(one)
        around = next(folder for folder in folders if path.startswith(f"{folder.rstrip('/')}/"))
        # an archive may have given a file of the user's another name
        if link_out(one) or not inside(path, around) or is_kept(os.path.realpath(path), os.path.realpath(around)):
            message = "it leads out of the folder in which it is named, or into a repository, and is not read"
            hint = f"if you mean what it leads to, name that: {quote(os.path.realpath(path))}; copy a hard link"
            raise Refused([Diagnostic(Position(one), message, hint=hint, code=Code.OUTSIDE)])
