"""The sha256 of bytes that many robots get, worked out once."""

from __future__ import annotations

import functools
import hashlib


@functools.lru_cache(maxsize=16)
def sha256_of(content: bytes) -> str:
    """Return the sha256 in hex."""
    return hashlib.sha256(content).hexdigest()
