"""Whether lines after an instruction of a Dockerfile may be its text, for builders that know here-documents. Pure.

Builders find the words of a here-document with a lexer of their own, which nests quotes in variables and variables in
quotes, and is another one in each version. So none of that is followed here: what looks as if it could come to two
signs side by side counts. Source: buildkit, frontend/dockerfile/parser and shell/lex.go.
"""

from __future__ import annotations

import re

_NONE = re.compile(r"<{3,}|\$\(\(\w+<<\w+\)\)", re.ASCII)
"""A here-string of bash, and arithmetic in one word."""
_BESIDE = re.compile(r"<(?:\$\w*|[\"'\\])*<")
"""With nothing in between but what a lexer may take for nothing."""


def may_begin(rest: str) -> bool:
    """Return whether a here-document may begin in what stands behind an instruction's name."""
    if rest.count("<") > 1 and "${" in rest:
        return True
    return _BESIDE.search(_NONE.sub(" ", rest)) is not None
