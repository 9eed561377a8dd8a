"""A repository that has the objects of another one, and nothing else of it: what its settings name may be any file.

Git follows `include` to wherever that leads, and what it then says, or whether it fails, tells of that file.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SHA256_DIGITS = 64
_CONFIG = "[core]\n\trepositoryformatversion = 1\n\tbare = true\n[extensions]\n\tobjectformat = {}\n"


@contextmanager
def repository(commit: str) -> Iterator[str]:
    """Yield the folder of an empty repository whose objects have names as long as a commit's.

    Raises:
        OSError: It cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="srprov-") as folder:
        for name in ("refs", "objects"):
            os.mkdir(f"{folder}/{name}")
        Path(folder, "HEAD").write_text("ref: refs/heads/none\n", encoding="utf-8")
        kind = "sha256" if len(commit) == _SHA256_DIGITS else "sha1"
        Path(folder, "config").write_text(_CONFIG.format(kind), encoding="utf-8")
        yield folder
