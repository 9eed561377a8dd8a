"""Documents that were found to fit their schema before: they need not be checked again, nor jsonschema be imported.

Takes a document's digest, gives whether it is known. A digest covers the document, the schema and the code that
checks, so it is known only what would be found again. Touches one file in the user's cache folder
(`XDG_CACHE_HOME`), of one digest per line; nothing is lost with it, and where it cannot be used everything is checked.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from functools import cache
from pathlib import Path

from srprov import believed, private
from srprov.yamldoc import nodes

_NAME = "documents"
_MOST_BYTES = 64 * 1024
_LINE = 65


def is_known(digest: str) -> bool:
    """Return whether a document with this digest was without fault."""
    return digest.encode("ascii") in _lines()


def add(digest: str) -> None:
    """Add a digest; when the file is full, it starts again with this one."""
    path = private.cache_folder() / _NAME
    with contextlib.suppress(OSError):
        believed.make_folder(path.parent)
        if path.is_symlink():
            return  # it may lead to another file of the user's
        full = path.exists() and path.stat().st_size > _MOST_BYTES - _LINE
        private.write_file(path, f"{digest}\n", os.O_TRUNC if full else os.O_APPEND)
        _lines.cache_clear()


@cache
def code() -> str:
    """Return a digest of the code that checks documents."""
    here = Path(__file__)
    code_files = (here.with_name("schema.py"), Path(nodes.__file__))
    return hashlib.sha256(b"".join(path.read_bytes() for path in code_files)).hexdigest()


@cache
def _lines() -> frozenset[bytes]:
    """Return the digests of a file that is the user's alone; somebody else's would say what is without fault."""
    try:
        return frozenset(believed.read(private.cache_folder() / _NAME, _MOST_BYTES).split())
    except OSError:
        return frozenset()
