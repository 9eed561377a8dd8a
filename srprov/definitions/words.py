"""A command line -> its words, as a POSIX shell splits them: `shlex.split`, in time that grows with the text alone.

Takes text; gives words. Pure. `shlex` copies a word for each of its characters, so long words in a stranger's file cost
seconds; tests hold this to what it gives.
"""

from __future__ import annotations

import re

_PIECE = re.compile(
    r"""(?P<space>[ \t\r\n]+)|(?P<plain>[^ \t\r\n'"\\#]+)|(?P<hash>#)|'(?P<single>[^']*)'"""
    r"""|"(?P<double>[^"\\]*(?:\\.[^"\\]*)*)"|\\(?P<escaped>.)""",
    re.DOTALL,
)

_QUOTES = frozenset("'\"\\#")
_PLAIN = re.compile(r"[^ \t\r\n]+")


def split(text: str, *, comments: bool = False) -> tuple[str, ...]:
    """Return the words of a command line; with `comments` a `#` outside of quotes hides the rest of its line.

    Raises:
        ValueError: A quote is not closed, or nothing follows the last backslash.
    """
    if _QUOTES.isdisjoint(text):
        return tuple(_PLAIN.findall(text))
    words: list[list[str]] = []
    position, between = 0, True
    while position < len(text):
        match = _PIECE.match(text, position)
        if match is None:
            raise ValueError("No escaped character" if text[position] == "\\" else "No closing quotation")
        position = match.end()
        if match["space"] or (comments and match["hash"]):
            between = True
            position = (text.find("\n", position) + 1 or len(text)) if match["hash"] else position
            continue
        if between:
            words.append([])
            between = False
        piece = match[match.lastgroup or 0]
        words[-1].append(re.sub(r"""\\(["\\])""", r"\1", piece) if match.lastgroup == "double" else piece)
    return tuple("".join(pieces) for pieces in words)
