"""Folders of a project's files: what lies apart from them, and what leads out of one. Looks at the file system."""

from __future__ import annotations

import os
from collections.abc import Collection
from shlex import quote

from srprov.codes import Code
from srprov.definitions.homes import homes_in
from srprov.definitions.paths import inside
from srprov.errors import Diagnostic
from srprov.importing.normal import Refused
from srprov.importing.position import Position


def innermost(folders: Collection[str], file: str) -> str:
    """Return the innermost of some folders around a file; empty where none is. Real paths."""
    return max((one for one in folders if inside(file, one)), key=len, default="")


def led_away(path: str, folders: Collection[str]) -> bool:
    """Return whether a link on a path's way leads out of the innermost of some folders in which it lies.

    Whoever names the path may name what lies there; but where the link leads is the word of whose folder it is in.
    """
    at = os.sep
    for part in os.path.abspath(path).split(os.sep):
        further = os.path.join(at, part)
        real = os.path.realpath(further) if os.path.islink(further) else further
        if real != further and (home := innermost(folders, at)) and not inside(real, home):
            return True
        at = real
    return False


def apart(what: str, first: str, folders: Collection[str], at: Position) -> Refused:
    """Return the refusal of what lies in another folder than a file before it; one of them may be a stranger's.

    Together they are one project, in which what one says of a service, or of a name, holds for all. `folders` are the
    real paths of all that are known.
    """
    around = os.path.commonpath([*folders])
    hint = f"where all is your own project: --root {quote(around)}, which lets each name what lies there"
    if around == os.sep or homes_in(around):
        hint = "where it is your own: copy it beside that one"
    message = f"{what} lies in a folder apart from {first}, and may be a stranger's"
    return Refused([Diagnostic(at, message, hint=f"{hint}; a stranger's import by itself", code=Code.OUTSIDE)])
