"""The variables of the environment by which folders and programs are found: none of them means the folder at hand.

Changes the environment that it is given. A project that was cloned has what it likes in that folder: as the user's home
it would be his configuration, and as a part of PATH his programs, also root's.
"""

from __future__ import annotations

import os
from collections.abc import MutableMapping

_LISTS = {"PATH": os.defpath, "LD_LIBRARY_PATH": "/nonexistent"}
"""Lists of folders -> what stands for one that has no whole path."""


def keep_to_whole_paths(environ: MutableMapping[str, str]) -> None:
    """Let HOME be the account's where it is no whole path, and keep of lists of folders the whole ones.

    An empty part of such a list is the folder at hand: `PATH=$PATH:` has one.
    """
    if not os.path.isabs(environ.get("HOME", "/")):
        del environ["HOME"]
        home = os.path.expanduser("~")
        if os.path.isabs(home):
            environ["HOME"] = home
    environ.setdefault("PATH", os.defpath)
    for name, none in _LISTS.items():
        if name in environ:
            parts = environ[name].replace(";", ":" if name != "PATH" else ";").split(":")  # ld.so parts at both
            environ[name] = ":".join(part for part in parts if os.path.isabs(part)) or none
