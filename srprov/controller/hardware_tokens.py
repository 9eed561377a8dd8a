"""What stands for serial numbers in a bundle: the same machine has the same token in all bundles of one user.

Takes facts; gives tokens, which are keyed hashes: a bare hash of a short number could be guessed. The key stays in the
user's folder for state, and is made when it is first needed. They are made when a run is recorded, not when it is
bundled, so that whoever bundles it gets the same bundle.

Source: RFC 2104.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import secrets
from collections.abc import Mapping
from pathlib import Path

from srprov import believed
from srprov.facts.model import HostFacts
from srprov.record import default_root

_KEY = "hardware.key"
_MOST_KEY = 1024
_KEY_BYTES = 32
_DIGITS = 32
"""As many as a machine's id has, so that facts stay what they are."""
_FOR = "srprov-hardware/1"


def tokens(facts: Mapping[str, HostFacts]) -> dict[str, str]:
    """Return machine id or serial number -> its token."""
    words = {one.machine_id for one in facts.values()}
    words |= {serial.partition(" ")[2] for one in facts.values() for serial in one.serials}
    key = _key() if words - {""} else b""
    return {word: _token(key, word) for word in sorted(words - {""})}


def _token(key: bytes, word: str) -> str:
    return hmac.new(key, f"{_FOR}|{word}".encode(), hashlib.sha256).hexdigest()[:_DIGITS]


def _key() -> bytes:
    """Return the user's key, made anew where there is none; where it cannot be kept, it is of this run alone."""
    path = Path(default_root().parent / _KEY)
    try:
        found = believed.read(path, _MOST_KEY).decode().strip()
    except FileNotFoundError:
        found = ""
    except (OSError, ValueError):  # it is not ours to replace, and no reason to run nothing
        return secrets.token_bytes(_KEY_BYTES)
    if len(found) < _KEY_BYTES:
        found = secrets.token_hex(_KEY_BYTES)
        with contextlib.suppress(OSError):  # as above
            believed.write(path, found + "\n", _MOST_KEY)
    return found.encode()
