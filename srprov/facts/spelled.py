"""What a robot's own files call things: the addresses of `/etc/hosts`, and the homes of its users.

Gives the question and reads the answer. Pure. The shell starts no program for it.
Source: hosts(5), passwd(5).
"""

from __future__ import annotations

import posixpath
import re
from ipaddress import ip_address

import msgspec

from srprov import names
from srprov.untrusted import folder, lines_of

MOST_LINES = 512
"""Of each file that are read, comments too."""
MOST_NAMES = 32
"""On one line."""
_LINE = 1024
_NOBODY = 65534
COMMAND = f"""\
n=0
while [ $n -lt {MOST_LINES} ] && {{ IFS= read -r l || [ -n "$l" ]; }}; do
  n=$((n + 1))
  case $l in [0-9a-fA-F:]*) printf 'host %s\\n' "$l";; esac
done 2>/dev/null </etc/hosts
[ $n -lt {MOST_LINES} ] || echo cut
n=0
while [ $n -lt {MOST_LINES} ] && IFS= read -r l; do
  n=$((n + 1)) i=${{l#*:*:}} h=${{l%:*}}
  i=${{i%%:*}}
  [ "$i" -eq 0 ] || [ "$i" -ge 1000 ] && printf 'home %s %s %s\\n' "$i" "${{l%%:*}}" "${{h##*:}}"
done 2>/dev/null </etc/passwd
:"""
_NAME = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_.-]{0,252}[A-Za-z0-9_])?")


class Spelled(msgspec.Struct, frozen=True):
    """Names of a robot."""

    hosts: tuple[str, ...] = ()
    """Lines of its hosts file: an address and the names that it has, with one blank between them."""
    hosts_cut: bool = False
    """The file is longer than what is read of it."""
    homes: tuple[str, ...] = ()
    """`USER:FOLDER` of root and of the users that people are; sorted."""


def parse_spelled(out: str) -> Spelled:
    """Read what the shell printed; a line that is none of a hosts file or of a user is left out."""
    lines = lines_of(out, 2 * MOST_LINES + 1)
    hosts = [line for one in lines if one.startswith("host ") and (line := _host(one[5 : 5 + _LINE]))]
    homes: dict[str, str] = {}
    for one in lines:
        user, home = _home(one[5 : 5 + _LINE]) if one.startswith("home ") else ("", "")
        homes.setdefault(user, home)  # the first of a name counts
    found = sorted(f"{user}:{home}" for user, home in homes.items() if user)
    return Spelled(hosts=tuple(hosts), hosts_cut="cut" in lines, homes=tuple(found))


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
    """Return a user and his home; two empty words for what is none."""
    uid, _, rest = line.partition(" ")
    user, _, place = rest.partition(" ")
    plain = folder(place) == place and posixpath.normpath(place) == place and ":" not in place
    return (user, place) if plain and names.valid("user", user) and uid != str(_NOBODY) else ("", "")
