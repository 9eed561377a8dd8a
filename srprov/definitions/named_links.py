"""Links in a path that a user names, which a project may have brought. Takes a path; raises. Looks at the files."""

from __future__ import annotations

import os
import shlex

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.paths import inside, link_out
from srprov.errors import UsageError


def refuse_link_out(path: str, named: str = "", about: str = "") -> None:
    """Refuse a relative path by which a link leads out of its folder: a project that was cloned may have brought it.

    Args:
        path: The path.
        named: What stands before it where it is named, such as `--facts `, for the hint.
        about: What the message begins with.

    Raises:
        UsageError: Names the link, and the whole path, which is taken as it is.
    """
    if link := link_out(path):
        hint = f"if you mean what it leads to, name that: {named}{shlex.quote(os.path.realpath(path))}"
        where = "leads out of its folder" if not inside(link, os.path.dirname(link)) else "leads into a repository"
        raise UsageError(f"{about}{link} is a link that {where}", hint=hint, code=Code.STRANGE_FILE)


def refuse_link(path: str) -> None:
    """Refuse a relative path with a link in it, for what goes elsewhere, or is written from elsewhere.

    One that leads out of its folder is refused as for all; one that stays may have come with an archive that was
    unpacked beside files of the user's.

    Raises:
        UsageError: Names the link, and the whole path, which is taken as it is.
    """
    refuse_link_out(path)
    if link := next(regular_file.links_in(path), ""):
        hint = f"if you mean what it leads to, name that: {shlex.quote(os.path.realpath(path))}"
        raise UsageError(f"{link} is a link, which a project may have brought", hint=hint, code=Code.STRANGE_FILE)
