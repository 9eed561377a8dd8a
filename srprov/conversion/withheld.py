"""Files that secrets are in: an import neither copies them nor puts what stands in them anywhere.

Takes paths; looks at the file system. A project may come from a stranger, and the files of its secrets are the user's:
whatever else of the project names one, as a mount or as a file of variables, does not get it.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Collection, Iterable, Mapping

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.paths import inside
from srprov.errors import Diagnostic
from srprov.importing.normal import Named, Refused


def is_withheld(path: str, secrets: Collection[str]) -> bool:
    """Return whether a path is the file of a secret, or lies in a folder that is one; all of them are real paths."""
    while path not in secrets:
        above = os.path.dirname(path)
        if above == path:
            return False
        path = above
    return True


def check_claimed(path: str, secrets: Collection[str], claims: Mapping[str, Collection[str]]) -> None:
    """Refuse to leave out what only files call a secret's that could not name it: a stranger's takes no file away.

    Raises:
        OSError: It is such a file.
    """
    those = [one for one in secrets if is_withheld(path, (one,)) or regular_file.is_one_of(path, (one,))]
    if all(one in claims and not any(inside(path, home) for home in claims[one]) for one in those):
        words = "it would be left out, as only a file in a folder apart calls it a secret's"
        raise OSError(errno.EPERM, words, path)


def refuse_read(named: Iterable[Named], secrets: Collection[str]) -> None:
    """Refuse projects in which what a file calls a secret's was read for what another line of them names.

    Its values would be in the experiment, under whatever names. Which files these are is known when all are read.

    Raises:
        Refused: Names each.
    """
    read = [one for one in named if is_withheld(one.file, secrets) or regular_file.is_one_of(one.file, secrets)]
    if read:
        raise Refused([_refusal(one) for one in dict.fromkeys(read)])


def _refusal(one: Named) -> Diagnostic:
    message = f"'{one.written[:80]}' is the file of a secret, and nothing else has it read"
    hint = "give the service that secret; or, if variables in the files are meant, name it yourself by --env-file"
    return Diagnostic(one.at, message, hint=hint, code=Code.OUTSIDE)
