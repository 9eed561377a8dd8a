"""Removes folders with all that lies in them, however deep that is: `shutil.rmtree` ends a thousand folders deep.

A container makes any number of folders in each other, and a stranger's file may lie in as many. Runs `rm`.
"""

from __future__ import annotations

import os
import subprocess


def remove(top: str | os.PathLike[str]) -> None:
    """Remove a folder; what cannot be removed stays, and so does what holds it. No link is followed."""
    if os.path.isdir(top) and not os.path.islink(top):
        subprocess.run(["rm", "-rf", "--", os.path.abspath(top)], stderr=subprocess.DEVNULL, check=False)
