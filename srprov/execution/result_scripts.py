"""The shell scripts that list and read what containers left, in the folder that they saw."""

from __future__ import annotations

import re

from srprov.sandbox import ELSEWHERE, LED_OUT, MISSING, MOUNTS_SEEN, NO_SANDBOX, NOT_CLOSED, inside

_NO_TOOLS = 46
WHY = {
    MISSING: "it is gone",
    LED_OUT: "a link leads out of its folder",
    _NO_TOOLS: "GNU find and sha256sum are needed there",
    NO_SANDBOX: NOT_CLOSED,
    ELSEWHERE: "its folder leads elsewhere than when its container was made",
}
"""Exit statuses with a meaning of their own."""
_LIST = (
    f"find . -prune -printf '' && sha256sum -z /dev/null >/dev/null || exit {_NO_TOOLS}; exec 3>&1; "
    "odd=$(LC_ALL=C find \"$what\" -xdev ! -type d -printf '%y %s %p\\0%l\\0' 2>&1 >&3 | grep -cv "
    "': No such file or directory$'); [ \"$odd\" = 0 ] || printf 'U 0 %s\\0\\0' \"${what%/}/.\"; printf 'H\\0'; "
    'find "$what" -xdev -type f -print0 | nice xargs -0 -r sha256sum -z --'
)
"""What went while it was listed is left out; what cannot be looked into is said (`U`)."""
TAR = (
    "tar --create --format=posix --sort=name --numeric-owner --hard-dereference --one-file-system"
    " '--pax-option=exthdr.name=%d/PaxHeaders/%f,delete=atime,delete=ctime,delete=mtime'"
)
UNNAMEABLE = re.compile(r"\n|\s\Z")
"""Paths that cannot stand in the list of what tar leaves out: they come though nobody needs them."""


def lists(root: str, path: str, real: str) -> str:
    """Return the script that lists a path below a root; see `sandbox.inside`."""
    return inside(root, path, _LIST, real, first=MOUNTS_SEEN)
