"""A repository that has the objects of another one, and nothing else of it: what its settings name may be any file.

Git follows `include` to wherever that leads, and what it then says, or whether it fails, tells of that file. So it does
with the names of packs in a `multi-pack-index`, and of graphs in a `commit-graph-chain`. Only loose objects and packs
with their own lists are handed on.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SHA256_DIGITS = 64
_CONFIG = "[core]\n\trepositoryformatversion = 1\n\tbare = true\n[extensions]\n\tobjectformat = {}\n"


_LOOSE, _PACK = re.compile("[0-9a-f]{2}"), re.compile(r"pack-[0-9a-f]{40,64}\.(pack|idx)")


@contextmanager
def repository(commit: str, objects: str) -> Iterator[str]:
    """Yield the folder of a repository with another one's objects, whose names are as long as a commit's.

    Raises:
        OSError: It cannot be written, or the objects cannot be read.
    """
    with tempfile.TemporaryDirectory(prefix="srprov-") as folder:
        for name in ("refs", "objects", "objects/pack"):
            os.mkdir(f"{folder}/{name}")
        packs = f"{objects}/pack"
        for where, form, here in (("", _LOOSE, objects), ("pack/", _PACK, packs)):
            for name in filter(form.fullmatch, os.listdir(here) if os.path.isdir(here) else ()):
                os.symlink(f"{here}/{name}", f"{folder}/objects/{where}{name}")
        Path(folder, "HEAD").write_text("ref: refs/heads/none\n", encoding="utf-8")
        kind = "sha256" if len(commit) == _SHA256_DIGITS else "sha1"
        Path(folder, "config").write_text(_CONFIG.format(kind), encoding="utf-8")
        yield folder
