"""Who works here, as locks, records and sources name him: `user@host`."""

from __future__ import annotations

import getpass
import os


def user() -> str:
    """Return the name of the user; `unknown` in a container without a passwd entry for him."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "unknown"


def owner() -> str:
    """Return `user@host`."""
    return f"{user()}@{os.uname().nodename}"
