"""A repository that has the objects of another one, and nothing else of it: what its settings name may be any file.

Git follows `include` to wherever that leads, and what it then says, or whether it fails, tells of that file. So it does
with the names of packs in a `multi-pack-index`, and of graphs in a `commit-graph-chain`. Only loose objects and packs
with their own lists are handed on.
"""

from __future__ import annotations

import itertools
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SHA256_DIGITS = 64
_CONFIG = "[core]\n\trepositoryformatversion = 1\n\tbare = true\n[extensions]\n\tobjectformat = {}\n"
_MOST_NAMES = 2000
"""In a folder of objects; each is linked, and its link removed. Git puts packs together where there are fifty, and each
has two names."""
_LOOSE, _PACK = re.compile("[0-9a-f]{2}"), re.compile(r"pack-[0-9a-f]{40,64}\.(pack|idx)")


@contextmanager
def repository(commit: str, objects: str) -> Iterator[str]:
    """Yield the folder of a repository with another one's objects, whose names are as long as a commit's.

    Raises:
        OSError: It cannot be written, the objects cannot be read, or there are too many packs.
    """
    with tempfile.TemporaryDirectory(prefix="srprov-") as folder:
        for name in ("refs", "objects", "objects/pack"):
            os.mkdir(f"{folder}/{name}")
        for there, form, here, short in (
            (objects, _LOOSE, "objects", "../o"),
            (f"{objects}/pack", _PACK, "objects/pack", "../../p"),
        ):
            # by one link to the folder: a short link lies in its inode, where a long one has a block, slow to give back
            os.symlink(there, f"{folder}/{short[-1]}")
            for name in _names(there, form):
                os.symlink(f"{short}/{name}", f"{folder}/{here}/{name}")
        Path(folder, "HEAD").write_text("ref: refs/heads/none\n", encoding="utf-8")
        kind = "sha256" if len(commit) == _SHA256_DIGITS else "sha1"
        Path(folder, "config").write_text(_CONFIG.format(kind), encoding="utf-8")
        yield folder


def _names(folder: str, form: re.Pattern[str]) -> list[str]:
    """Return the names in a folder that have a form, none where it is no folder."""
    if not os.path.isdir(folder):
        return []
    with os.scandir(folder) as entries:
        names = list(itertools.islice((one.name for one in entries if form.fullmatch(one.name)), _MOST_NAMES + 1))
    if len(names) > _MOST_NAMES:
        raise OSError(f"{folder} has more than {_MOST_NAMES} names of packs: 'git gc' puts them together")
    return names
