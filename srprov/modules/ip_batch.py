"""Calls of one program of iproute2 as lines of a script, in as few processes as their words allow. Pure.

Source: ip(8), bridge(8), `-batch`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from srprov.wire import printed, sh

_PLAIN = re.compile(r"[\w.:@%/+-]+", re.ASCII)


def batch(program: Sequence[str], calls: Sequence[Sequence[str]]) -> list[str]:
    """Return shell lines for calls of one program, such as `ip -n NAME`, up to the first that fails.

    One process does them all. A line of its batch cannot quote everything, so words that are not plain get a process
    per call, and the shell's quotes.
    """
    if all(_PLAIN.fullmatch(word) for call in calls for word in call):
        text = "".join(" ".join(call) + "\n" for call in calls)
        return [f"{printed(text)} | {sh(*program)} -batch - || exit"] if calls else []
    return [f"{sh(*program, *call)} || exit" for call in calls]
