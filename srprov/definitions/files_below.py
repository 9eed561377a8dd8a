"""A folder that a user names for its definitions -> the EDFs and CDFs in it, as users write them.

Records of runs hold copies of such files, which stay as they were. Reads folders; follows no link.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

from srprov import own_records
from srprov.codes import Code
from srprov.errors import UsageError

ENDINGS = {f".{kind}{yaml}": kind for kind in ("edf", "cdf") for yaml in ("", ".yml", ".yaml")}
_MOST_FILES = 1000
_MOST_LOOKED_AT = 50_000
_DEEPEST = 8


def with_files_below(paths: Sequence[str]) -> list[str]:
    """Return the paths, each folder with EDFs or CDFs replaced by these, sorted; other folders are inventories.

    Raises:
        UsageError: A folder holds more than anybody means.
    """
    found: list[str] = []
    for path in paths:
        found += (below(path) if os.path.isdir(path) else []) or [path]
    return list(dict.fromkeys(found))


def kind_by_name(path: str) -> str:
    """Return `edf` or `cdf` where a file's name says so; else nothing.

    Such a file is never an inventory, whatever is in it and whoever may run it: an inventory may be a program.
    """
    name = path.lower()
    return next((kind for ending, kind in ENDINGS.items() if name.endswith(ending)), "")


def below(top: str) -> list[str]:
    """Return the EDFs and CDFs in a folder and below it, sorted, without those in hidden folders and in records.

    Raises:
        UsageError: It holds more than anybody means.
    """
    found: list[str] = []
    seen = 0
    for folder, folders, files in os.walk(top):
        if folder != top and own_records.is_record(folder):
            folders.clear()
            continue
        deep = os.path.relpath(folder, top).count(os.sep) + 1 >= _DEEPEST
        folders[:] = [] if deep else sorted(name for name in folders if not name.startswith("."))
        found += [os.path.join(folder, name) for name in files if kind_by_name(name)]
        seen += len(files) + len(folders)
        if len(found) > _MOST_FILES or seen > _MOST_LOOKED_AT:
            hint = "name the files, or a folder of one experiment"
            raise UsageError(f"there is too much in {top} to look through", hint=hint, code=Code.TOO_LARGE)
    return sorted(found)
