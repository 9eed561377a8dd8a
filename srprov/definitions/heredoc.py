"""Whether lines after an instruction of a Dockerfile may be its text, for builders that know here-documents. Pure."""

from __future__ import annotations

import re

_PLAIN = re.compile(
    r"\"(?:\\.|\\\Z|[^\"\\])*(?P<double>\"?)|'[^']*(?P<single>'?)|<<<|\$\(\([^()\s\"'\\]*\)\)", re.DOTALL
)
"""What no here-document begins in: arithmetic with blanks is split there. A quote that does not end is matched up to
the end: each is looked at once."""
_HEREDOC = re.compile(r"<<|\\|\$\{(?:(?!\$\{)[^}<])*<")
"""What may begin one elsewhere."""


def may_begin(rest: str) -> bool:
    """Return whether a here-document may begin in what stands behind an instruction's name."""
    if "<<" not in rest:
        return False
    left, at = [], 0
    for found in _PLAIN.finditer(rest):
        if "" in (found["double"], found["single"]):
            return True  # builders differ in what a quote is that does not end
        left.append(rest[at : found.start()])
        at = found.end()
    return _HEREDOC.search(" ".join([*left, rest[at:]])) is not None
