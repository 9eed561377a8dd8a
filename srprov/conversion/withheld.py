"""Files that secrets are in: an import neither copies them nor puts what stands in them anywhere.

Takes paths; looks at the file system. A project may come from a stranger, and the files of its secrets are the user's:
whatever else of the project names one, as a mount or as a file of variables, does not get it.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable

from srprov import regular_file
from srprov.codes import Code
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


def refuse_read(named: Iterable[Named], secrets: Collection[str]) -> None:
    """Refuse projects in which what a file calls a secret's was read for what another line of them names.

    Its values would be in the experiment, under whatever names. Which files these are is known when all are read.

    Raises:
        Refused: Names each.
    """
    known, all_named = regular_file.identities(secrets), dict.fromkeys(named)
    files = dict.fromkeys(one.file for one in all_named)  # each of them once, however often it is named
    read = {one for one in files if is_withheld(one, secrets) or not known.isdisjoint(regular_file.identities([one]))}
    if read:
        raise Refused([_refusal(one) for one in all_named if one.file in read])


def _refusal(one: Named) -> Diagnostic:
    message = f"'{one.written[:80]}' is the file of a secret, and nothing else has it read"
    hint = "give the service that secret; or, if variables in the files are meant, name it yourself by --env-file"
    return Diagnostic(one.at, message, hint=hint, code=Code.OUTSIDE)
