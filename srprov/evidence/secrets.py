"""What must not leave the house: values of the experiment's secrets, and what looks like a key or a password.

Takes a file's content in pieces; gives what was found in it, in words. Values are those that `redact` knows, in every
form; patterns are few, and each has a shape that is hardly anything else. Files may be large and hostile, so patterns
are matched in linear time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from srprov.linear_regex import compiled
from srprov.secret import redact

OVERLAP = 16 * 1024
"""Bytes of a piece that are looked at again with the next one."""
_PATTERNS = {
    "a private key": r"-----BEGIN [A-Z ]{0,30}PRIVATE KEY-----|PuTTY-User-Key-File-[0-9]",
    "an access key of AWS": r"\b(?:AKIA|ASIA)[0-9A-Z]{16}\b",
    "a token of GitHub, GitLab or Slack": (
        r"\b(?:gh[pousr]_[A-Za-z0-9]{36}|github_pat_\w{50}|glpat-[\w-]{20}|xox[abprs]-[\w-]{10})"
    ),
    "a password": (
        r"(?i)(?:password|passwd|passphrase|\bpsk)[\"']?\s{0,3}[=:]\s{0,3}[\"']?([^\s\"'{}\[\]()<>$*,;]{6,100})"
    ),
    "a password in an address": r"\b[a-z][a-z0-9+.-]{1,20}://[^\s/:@\"']{1,100}:([^\s/@\"*]{4,100})@",
}
_WORDS = frozenset({b"unknown", b"required", b"missing", b"optional"})
"""What stands for a password where there is none."""


def found(pieces: Iterable[bytes]) -> str:
    """Return what looks like a secret in a file, in words, or nothing."""
    for part in _parts(pieces):
        text = part.decode("utf-8", "surrogateescape")
        if redact(text) != text:
            return "the value of a secret"
        for kind, pattern in _PATTERNS.items():
            match = compiled(pattern).search(part)
            if match and not (match.groups() and match.group(1).lower() in _WORDS):
                return f"what looks like {kind}"
    return ""


def _parts(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Return overlapping parts of a file."""
    before = b""
    for piece in pieces:
        part = before + piece
        yield part
        before = part[-OVERLAP:]
