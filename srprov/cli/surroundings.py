"""The variables of the environment by which folders and programs are found: none of them means the folder at hand.

Changes the environment that it is given. A project that was cloned has what it likes in that folder: as the user's home
it would be his configuration, and as a part of PATH his programs, also root's.
"""

from __future__ import annotations

import os
import re
from collections.abc import MutableMapping

_LISTS = {"PATH": (":", os.defpath), "LD_LIBRARY_PATH": ("[:;]", "/nonexistent")}
"""Lists of folders -> what is between two of them (ld.so(8)), and what stands for a list without a whole path."""


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
    for name, (between, none) in _LISTS.items():
        if name in environ:
            whole = [part for part in re.split(between, environ[name]) if os.path.isabs(part)]
            environ[name] = ":".join(whole) or none
