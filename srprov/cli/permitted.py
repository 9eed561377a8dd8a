"""What the user allows, and what the policies of this machine and this user leave of it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from srprov.cli.config import user_folder

if TYPE_CHECKING:
    from srprov.controller.labpolicy import Policies

_MACHINE_FOLDER = Path("/etc/srprov")


def permitted(allow: tuple[str, ...]) -> tuple[Policies, frozenset[str]]:
    """Return the policies of this machine and this user, and what they leave of the permissions that the user gives."""
    from srprov.controller.permissions import check_kinds

    check_kinds(allow)
    return _lab_policies(allow)


def _lab_policies(allow: tuple[str, ...]) -> tuple[Policies, frozenset[str]]:
    """Return the policies of this machine and this user, and what is left of the permissions that the user gives."""
    own = user_folder(os.environ)
    if not any(_there(folder / "policy.yml") for folder in (_MACHINE_FOLDER, own)):
        return (), frozenset(allow)  # nothing of it is imported then
    from srprov.controller.labpolicy import narrowed, read_policies

    policies = read_policies(own, _MACHINE_FOLDER)
    return policies, narrowed(allow, policies)


def _there(path: Path) -> bool:
    """Return whether there is something; what cannot be looked at counts, and is told by who reads it."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True
