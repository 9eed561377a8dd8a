"""Whether a robot can close an overlay: which of the programs that make rules for packets it has.

Gives the question and reads the answer. Pure. The shell starts no program for it, so that one which is there and does
not work is found by `doctor`, and by the step that makes the rules.
"""

from __future__ import annotations

from srprov.untrusted import lines_of

NONE = "none"
_PROGRAMS = {"nftables": ("nft",), "iptables": ("iptables-save", "iptables-restore")}
COMMAND = (
    "".join(
        f"{' && '.join(f'command -v {one} >/dev/null 2>&1' for one in programs)} && echo {name}\n"
        for name, programs in _PROGRAMS.items()
    )
    + f"echo {NONE}"
)


def parse_rules(out: str) -> str:
    """Return `nftables`, `iptables` or `none`, the first that was said; empty where nothing was."""
    said = lines_of(out, 8)
    return next((one for one in said if one in (*_PROGRAMS, NONE)), "")
