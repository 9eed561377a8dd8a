"""Homes of the people whose files lie beside a definition: keys and tokens are in known places of them.

Takes a folder; gives the homes that it is, or holds. Looks where links lead, and who a folder belongs to.
"""

from __future__ import annotations

import contextlib
import functools
import os
import pwd
from collections.abc import Iterator

_WHO_ASKED = ("SUDO_UID", "PKEXEC_UID")
"""Variables that say who became the user that this runs as: HOME is then that one's."""


def homes_in(folder: str) -> list[str]:
    """Return the real paths of homes that a folder is, or that lie below it.

    They are those of the user, also of the one who called this by sudo, and of whoever the folder belongs to.
    """
    root = os.path.realpath(folder)
    named = {os.path.expanduser("~"), *_of_users(root)}
    real = {os.path.realpath(home) for home in named if os.path.isabs(home)}
    return sorted(home for home in real if home == root or home.startswith(root.rstrip("/") + "/"))


def _of_users(root: str) -> Iterator[str]:
    given = (os.environ.get(name, "") for name in _WHO_ASKED)
    users = {os.getuid(), *(int(one) for one in given if one.isdecimal() and len(one) <= 10)}
    with contextlib.suppress(OSError, ValueError):  # who reads something in it says so
        users.add(os.stat(root).st_uid)
    for user in users:
        if home := _home(user):
            yield home


@functools.cache
def _home(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_dir
    except (KeyError, OverflowError):
        return ""
