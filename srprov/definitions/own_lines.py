"""Problems of definitions -> the same, but of the user's own files nothing of what is in them.

An EDF or a CDF may name any file beside it, as one of variables or as a Dockerfile, and what is wrong with a file is
shown with its line: in a terminal, and in the log of whoever checks a stranger's change, which everybody may read.
Takes problems; looks at the files that they are about.
"""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Collection

from srprov import own_records, regular_file, secret_files
from srprov.codes import Code
from srprov.definitions.own_content import LARGEST, is_own
from srprov.definitions.paths import belongs
from srprov.definitions.version_control import is_kept
from srprov.errors import Diagnostic, Location, did_you_mean


def hide_own(problems: Collection[Diagnostic], named: str, folder: str) -> list[Diagnostic]:
    """Return problems, of each own file one that says nothing but that there is one.

    Args:
        problems: What is wrong.
        named: The file that the user himself named.
        folder: What version control keeps below it is the user's own.
    """
    if not problems:
        return []
    root, secrets = os.path.realpath(folder), secret_files.known()
    but = os.path.realpath(named)

    @functools.cache
    def own(file: str) -> bool:
        return bool(file) and os.path.realpath(file) != but and is_users_own(file, root, secrets)

    shown = (_hidden(one.location.file) if own(one.location.file) else one for one in problems)
    return list(dict.fromkeys(shown))


def is_users_own(file: str, root: str, secrets: Collection[str]) -> bool:
    """Return whether a file is the user's own, whatever names it: a secret's, version control's, or of a record.

    So is one by what is in it. All that reads, copies or quotes what a stranger's file names asks this. Who ships what
    lies in a folder leaves version control out, and tells which record it is (`own_files`); who copies, and has keys
    known by their content afterwards, asks only for what is known by its place (`record_around`).

    Args:
        file: Its path.
        root: What version control keeps below it counts, and records below it do; a path without links.
        secrets: Files that secrets were read from.
    """
    with contextlib.suppress(OSError, ValueError):  # who reads it said so
        real = os.path.realpath(file)
        if os.path.isfile(real):
            if own_records.record_around(os.path.dirname(real), root):
                return True
            if regular_file.is_one_of(real, secrets) or is_kept(real, root):
                return True
            return is_own(regular_file.read(real, LARGEST))
    return False


def may_quote(file: str, folder: str) -> bool:
    """Return whether names out of a file may be told at the line that names it: it is the experiment's own.

    `hide_own` and `hiding.hide_outside` go by where a problem stands, and such a line is in the EDF or CDF.
    """
    root = os.path.realpath(folder)
    return belongs(file, root) and not is_users_own(file, root, secret_files.known())


def meant(path: str, folder: str) -> str:
    """Return as a hint what a path that is not there may mean; nothing where its folder is not the experiment's.

    Args:
        path: What an EDF or a CDF names.
        folder: The experiment's.
    """
    place = os.path.dirname(path)
    with contextlib.suppress(OSError, ValueError):
        root, real = os.path.realpath(folder), os.path.realpath(place)
        if belongs(real, root) and not own_records.record_around(real, root):
            return did_you_mean(os.path.basename(path), regular_file.names_beside(path))
    return ""


def _hidden(file: str) -> Diagnostic:
    message = "is not valid; what is wrong is not shown of a file that is kept by version control, lies in a record or"
    message += " among an export's secrets, or has a key, a secret or a password of robots"
    hint = "name another file, or look at it yourself"
    return Diagnostic(Location(file), message, hint=hint, code=Code.OUTSIDE)
