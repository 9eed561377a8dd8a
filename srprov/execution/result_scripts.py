"""The shell scripts that list and read what containers left, in the folder that they saw."""

from __future__ import annotations

import posixpath
import re

from srprov.sandbox import ELSEWHERE, MISSING, NO_SANDBOX, NOT_CLOSED, sandboxed
from srprov.wire import quote

_LED_OUT, _NO_TOOLS = 45, 46
WHY = {
    MISSING: "it is gone",
    _LED_OUT: "a link leads out of its folder",
    _NO_TOOLS: "GNU find and sha256sum are needed there",
    NO_SANDBOX: NOT_CLOSED,
    ELSEWHERE: "its folder leads elsewhere than when its container was made",
}
"""Exit statuses with a meaning of their own."""
LIST = (
    f"find . -prune -printf '' && sha256sum -z /dev/null >/dev/null || exit {_NO_TOOLS}; "
    "find \"$what\" -xdev ! -type d -printf '%y %s %p\\0%l\\0'; printf 'H\\0'; "
    'find "$what" -xdev -type f -print0 | nice xargs -0 -r sha256sum -z --'
)
TAR = (
    "tar --create --format=posix --sort=name --numeric-owner --hard-dereference --one-file-system"
    " '--pax-option=exthdr.name=%d/PaxHeaders/%f,delete=atime,delete=ctime,delete=mtime'"
)
UNNAMEABLE = re.compile(r"\n|\s\Z")
"""Paths that cannot stand in the list of what tar leaves out: they come though nobody needs them."""
_WHY_NOT = (
    'set -f; IFS=/; at=.; for part in $folder; do at="$at/$part"; '
    f'[ ! -L "$at" ] || exit {_LED_OUT}; done; exit {MISSING}'
)


def ending(script: str) -> str:
    """Return a script that says on stderr how another one ended."""
    return f'( {script} ); echo "srprov-end $?" >&2'


def inside(root: str, path: str, script: str, real: str = "") -> str:
    """Return a script that runs another in the folder of a path below a root, where `what` is its name.

    `real` is where the root has to lead, if that is known.

    The kernel says where the working folder is: whatever runs there may put links in the way meanwhile, and neither tar
    nor find nor dd follow one that they are named.
    """
    folder, name = posixpath.split(posixpath.normpath(path))
    go = (
        f"here=$(pwd -P); folder={quote(folder)}; what={quote('./' + (name if name != '.' else ''))}; "
        f'if [ "$folder" ] && ! cd -- "./$folder" 2>/dev/null; then {_WHY_NOT}; fi; '
        f'[ "$(pwd -P)" = "${{here%/}}${{folder:+/$folder}}" ] || [ -z "$folder" ] || exit {_LED_OUT}; '
        f'[ -e "$what" ] || [ -L "$what" ] || exit {MISSING}'
    )
    return sandboxed(root, f"{go}; {script}", real)
