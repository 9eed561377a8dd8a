"""Text of an inventory that its reader does not see as srprov reads it.

Takes a text; raises. Pure. An inventory may run a program here, so its user looks at it first. A character that ends a
line to a parser, and to no editor, makes a setting of what stands in a comment; one that moves a terminal's cursor, or
turns the writing around, hides one; so do blanks, behind which it stands beside the window.
"""

from __future__ import annotations

import re

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location

_UNSEEN = re.compile(
    "\r(?!\n|\\Z)|\x0c(?![\r\n]|\\Z)|[\x01-\x08\x0b\x0e-\x1f\x7f-\x9f]"
    "|[\u061c\u2028-\u202e\u2066-\u2069]|[\U000e0000-\U000e007f]"
)
"""Control characters but tabs and ends of lines; a form feed may end a line, as that of a page.

A NUL ends and hides nothing; what is read has none anyway.
"""
_BESIDE = re.compile(r"[ \t]{100}")


def check(text: str, path: str) -> None:
    """Refuse a text with such a character, or with a hundred blanks before something.

    Raises:
        DefinitionError: It names the place.
    """
    if found := _UNSEEN.search(text):
        before = text[: found.start()]
        place = Location(path, before.count("\n") + 1, found.start() - before.rfind("\n"))
        shown = found[0].encode("unicode_escape").decode()
        message = f"has the character {shown} here: what stands around it may be read otherwise than it is seen"
        hint = "look at it with `cat -A`; lines end with a line feed, and there is no other such character"
        raise DefinitionError([Diagnostic(place, message, hint=hint, code=Code.INVENTORY)])
    for number, line in enumerate(text.split("\n"), 1):
        if found := _BESIDE.search(line.rstrip()):
            message = "has so many blanks that what stands behind them is not seen in many a window"
            place = Location(path, number, found.start() + 1)
            raise DefinitionError([Diagnostic(place, message, hint="take them away", code=Code.INVENTORY)])
