"""What a robot's own files call things: the addresses of `/etc/hosts`, and the homes of its users.

Takes their lines, which `probes.py` asks for. Pure.
Source: hosts(5), passwd(5).
"""

from __future__ import annotations

import posixpath
import re
from ipaddress import ip_address

import msgspec

from srprov import names
from srprov.facts.answers import Files
from srprov.untrusted import folder, integer

HOSTS, USERS = "/etc/hosts", "/etc/passwd"
MOST_LINES = 512
"""Of each file that are read, comments too."""
MOST_NAMES = 32
"""On one line."""
_LINE = 1024
_NOBODY = 65534
_FIRST_PERSON = 1000
"""The least number of a user who is no part of the system, but for root's."""
_NAME = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]{0,252}[A-Za-z0-9_])?")


class Spelled(msgspec.Struct, frozen=True):
    """Names of a robot."""

    hosts: tuple[str, ...] = ()
    """Lines of its hosts file: an address and the names that it has, with one blank between them."""
    hosts_cut: bool = False
    """The file is longer than what is read of it."""
    homes: tuple[str, ...] = ()
    """`USER:FOLDER` of root and of the users that people are; sorted."""


def read_spelled(files: Files) -> Spelled:
    """Read both files; a line that is none of a hosts file or of a user is left out."""
    lines = files.get(HOSTS, ())
    hosts = [line for one in lines[:MOST_LINES] if (line := _host(one[:_LINE]))]
    homes: dict[str, str] = {}
    for one in files.get(USERS, ())[:MOST_LINES]:
        user, home = _home(one[:_LINE])
        homes.setdefault(user, home)  # the first of a name counts
    found = sorted(f"{user}:{home}" for user, home in homes.items() if user)
    return Spelled(hosts=tuple(hosts), hosts_cut=len(lines) > MOST_LINES, homes=tuple(found))


def _host(line: str) -> str:
    """Return an address with its names; a comment after them, and a name that is none, are left out."""
    address, *named = line.partition("#")[0].split()[: MOST_NAMES + 1] or [""]
    try:
        at = ip_address(address)
    except ValueError:
        return ""
    # what has a zone is of one machine's interface alone
    found = [name for name in named if _NAME.fullmatch(name)] if "%" not in address else []
    return " ".join([str(at), *found]) if found else ""


def _home(line: str) -> tuple[str, str]:
    """Return a user and his home; two empty words for what is none, and for users that are part of the system."""
    user, *_, place, _shell = [*line.split(":"), *[""] * 7][:7]
    uid = integer(line.split(":")[2], default=-1) if line.count(":") == 6 else -1
    plain = folder(place) == place and posixpath.normpath(place) == place and ":" not in place
    people = uid == 0 or (uid >= _FIRST_PERSON and uid != _NOBODY)
    return (user, place) if people and plain and names.valid("user", user) else ("", "")
