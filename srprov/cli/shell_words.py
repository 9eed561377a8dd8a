"""The words of a shell's command line that is being typed: quotes may be open, and nothing is expanded. Pure."""

from __future__ import annotations

import re

_WORD = re.compile(r"""(?:\\.|'[^']*(?:'|\Z)|"(?:\\.|[^"\\])*(?:"|\Z)|[^\s'"\\]|\\\Z)+""", re.DOTALL)
_PART = re.compile(r"""\\(.)|'([^']*)(?:'|\Z)|"((?:\\.|[^"\\])*)(?:"|\Z)|([^'"\\])""", re.DOTALL)


def split(line: str) -> tuple[list[str], str]:
    """Return the words of a shell's line between the program and the last one, and what there is of that one.

    Quotes may be open at the end. Variables and the like are not expanded: a word that has one names no file.
    """
    found = [unquoted(one[0]) for one in _WORD.finditer(line)]
    if not line or line[-1].isspace():
        found.append("")
    while found and re.match(r"[A-Za-z_][A-Za-z0-9_]*=", found[0]):
        del found[0]
    return found[1:-1], found[-1] if len(found) > 1 else ""


def unquoted(word: str) -> str:
    """Return a word of a shell without its quotes, as far as it is typed."""

    def part(match: re.Match[str]) -> str:
        escaped, single, double, plain = match.groups()
        if double is not None:
            return re.sub(r'\\([\\"$`])', r"\1", double)
        return escaped or single or plain or ""

    return _PART.sub(part, word)
