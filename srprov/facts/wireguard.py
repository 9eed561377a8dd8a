"""Whether a robot can encrypt an overlay: WireGuard in its kernel or as a process, and the program that sets it up.

Gives the question and reads the answer. Pure. The shell starts no program for it.
"""

from __future__ import annotations

import msgspec

from srprov.untrusted import lines_of

_MODULE = "wireguard.ko*"
COMMAND = f"""\
command -v wg >/dev/null 2>&1 && echo tools
r= ; read -r r 2>/dev/null </proc/sys/kernel/osrelease
for f in /sys/module/wireguard /lib/modules/"$r"/kernel/drivers/net/wireguard/{_MODULE} \\
  /lib/modules/"$r"/extra/{_MODULE} /lib/modules/"$r"/updates/dkms/{_MODULE}; do
  [ -e "$f" ] && echo kernel
done
command -v wireguard-go >/dev/null 2>&1 && [ -c /dev/net/tun ] && echo userspace
:"""


class WireguardAnswer(msgspec.Struct, frozen=True):
    """What a robot has."""

    by: str = ""
    """`kernel` or `userspace`, or empty."""
    problem: str = ""
    """Why it is empty, in words."""


def parse_wireguard(out: str) -> WireguardAnswer:
    """Read the words that the shell printed."""
    said = set(lines_of(out, 8))
    by = next((one for one in ("kernel", "userspace") if one in said), "")
    if "tools" not in said:
        return WireguardAnswer(problem="it has no program wg")
    return WireguardAnswer(by) if by else WireguardAnswer(problem="neither its kernel has it, nor has it wireguard-go")
