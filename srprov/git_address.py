"""Addresses of git repositories and names in them, in the few forms that git cannot take for anything else.

Takes text of a user's file; gives an Address. Pure. Git itself takes much more: programs (`ext::`), options that look
like addresses (`--upload-pack=…`), paths, bundles. None of that is an address here.
"""

from __future__ import annotations

import posixpath
import re

import msgspec

_HOST = r"(?:[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:]+\])(?::[0-9]{1,5})?"
_USER = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"
_PATH = r"/[A-Za-z0-9._~+%@=,:/-]+"
_HTTPS = re.compile(f"https://{_HOST}{_PATH}")
_SSH = re.compile(f"ssh://(?:{_USER}@)?{_HOST}{_PATH}")
_SCP = re.compile(f"{_USER}@[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?:[A-Za-z0-9._~/][A-Za-z0-9._~+%@=,/-]*")
_FILE = re.compile(r"file://(/[^\x00-\x20\x7f-\x9f\u2028\u2029\\?#%]*)")
_REF = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+@/-]*")
_COMMIT = re.compile(r"[0-9a-f]{40}|[0-9a-f]{64}")
_LONGEST = 1000
_LONGEST_REF = 200
_FORMS = "https://host/path, ssh://user@host/path, user@host:path or file:///path"


class Address(msgspec.Struct, frozen=True, order=True):
    """Where a repository is."""

    url: str
    """As git takes it."""
    scheme: str
    """`https`, `ssh` or `file`."""
    path: str = ""
    """Of a repository on this machine: its absolute path."""


def parse_address(text: str) -> Address:
    """Read an address.

    Raises:
        ValueError: It is of no form that srprov fetches from; the message does not repeat a password in it.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"an address of a repository has at most {_LONGEST} characters")
    if re.match(r"https://[^/]*@", text) or re.match(r"ssh://[^/@]*:[^/]*@", text):
        raise ValueError("no user or password belongs into an address: it would be in plans and images")
    if _HTTPS.fullmatch(text):
        return Address(text, "https")
    if _SSH.fullmatch(text) or _SCP.fullmatch(text):
        return Address(text, "ssh")
    local = _FILE.fullmatch(text)
    if local and ".." not in local[1].split("/") and posixpath.normpath(local[1]) != "/":
        path = "/" + posixpath.normpath(local[1]).lstrip("/")  # two slashes at the beginning stay, to POSIX
        return Address(f"file://{path}", "file", path)
    raise ValueError(f"'{text[:80]}' is no address that srprov fetches from: {_FORMS}")


def check_ref(text: str) -> str:
    """Return the name of a branch, tag or commit.

    Raises:
        ValueError: It is none.
    """
    parts = text.split("/")
    wrong = ".." in text or any(not part or part.startswith(".") or part.endswith((".", ".lock")) for part in parts)
    if len(text) > _LONGEST_REF or wrong or not _REF.fullmatch(text):
        raise ValueError(f"'{text[:80]}' is no name of a branch, a tag or a commit")
    return text


def is_commit(ref: str) -> bool:
    """Return whether a name is that of a commit, in full, which never moves."""
    return _COMMIT.fullmatch(ref) is not None
