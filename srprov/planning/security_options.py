"""What `security_opt` of a container gives away: options that an engine reads as it likes, one of which is a program.

A profile of seccomp says of each call what becomes of it, also that it is not done and counts as done. The engine's own
calls that take a container's capabilities away come after it is in force: such a profile leaves it all of them. Pure.

Source: moby, `parseSecurityOpt`; runc, `standard_init_linux.go`; seccomp(2).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from srprov.planning.graver import AS_ROOT, MAY_BE

_ORDINARY = re.compile(
    r"no-new-privileges(?:[=:](?:true|false))?|seccomp[=:]builtin"
    r"|(?:apparmor|label)[=:][A-Za-z0-9_.:,/-]+"
)
"""What is known to leave a container what an engine gives and hides, as it is.

A closed list: engines learn new options, such as `writable-cgroups`. AppArmor and SELinux only ever take away.
"""
_PROFILE = re.compile(r"seccomp\s*[=:]")
PROFILE = f"{AS_ROOT}, as a profile of its own may leave it all capabilities"
UNCONFINED = f"{MAY_BE}, as it reads what root's programs keep in the kernel's keyrings, such as a disk's password"
"""These are a user's, by its number, in whatever container; the engine's own profile of seccomp is what keeps them."""
_UNCONFINED = re.compile(r"seccomp[=:]unconfined")


def of_security(options: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield kind and words of what options ask for; of a profile, which may be long, first why it is grave."""
    for option in options:
        why = of_option(option)
        yield "security-opt", f"{why}: {option}" if why else option


def of_option(option: str) -> str:
    """Return why an option is more than it looks, or nothing; no word of the option's own is in it."""
    why = "" if _ORDINARY.fullmatch(option) else UNCONFINED if _UNCONFINED.fullmatch(option) else MAY_BE
    return PROFILE if why == MAY_BE and _PROFILE.match(option) else why
