"""Whether containers can get out of a robot's runc: what its engine says of its version. Pure; that is untrusted.

Source: Docker Engine API 1.41 (`/version`); CVE-2025-31133, mended in runc 1.2.8 and 1.3.3. With older ones a volume
that a link in the image leads to /dev turns what a container prints into writes to files of /proc/sys: it is root.
"""

from __future__ import annotations

import re

from srprov.untrusted import mapping, mappings, text
from srprov.wire import EngineQuery, Reply

RUNC = EngineQuery(path="/version")
REMEDY = (
    "update runc to 1.2.8, 1.3.3 or newer, unless your distribution has mended CVE-2025-31133 in this one; "
    "until then run images and CDFs of people you trust alone"
)
_MENDED = {(1, 2): 8, (1, 3): 3}
"""Series -> first release that has it; later series have it from the beginning."""
_MENDED_BY_DEBIAN = re.compile(r"1\.1\.15\+ds1-2\+deb13u[1-9].{0,40}")


def runc(reply: Reply) -> tuple[bool, str]:
    """Return whether no container is known to get out, and which version it is, in words."""
    answer = mapping(reply.json()) if reply.ok else {}
    found = next((one for one in mappings(answer.get("Components")) if one.get("Name") == "runc"), None)
    if found is None:
        return True, "not runc, or not told"
    version, commit = (
        text(found.get("Version"), length=64),
        text(mapping(found.get("Details")).get("GitCommit"), length=64),
    )
    numbers = re.match(r"v?([0-9]{1,4})\.([0-9]{1,4})\.([0-9]{1,4})", version, re.ASCII)
    if numbers is None:
        return True, "its version is not told"
    major, minor, patch = map(int, numbers.groups())
    last = max(_MENDED)
    mended = (major, minor) > last or patch >= _MENDED.get((major, minor), patch + 1)
    return mended or _MENDED_BY_DEBIAN.fullmatch(commit) is not None, commit if version in commit else version
