"""Mark the containers of a build, so that those which a killed build leaves behind are known as ours. Pure.

An engine gives containers of a build no name and no label of its own, but each has the labels that the Dockerfile set
before it. The last instruction takes the mark away again: whoever runs the image runs no part of a build.
"""

from __future__ import annotations

import re

from srprov.errors import Location
from srprov.images.dockerfile import instruction_lines
from srprov.images.plan import Dockerfile

MARK = "LABEL srprov.instance=.build"
UNMARK = 'LABEL srprov.instance=""'
_FROM = re.compile(r"[ \t]*FROM[ \t\\]", re.IGNORECASE)


def marked(dockerfile: Dockerfile) -> Dockerfile:
    """Return the Dockerfile with the mark in every stage, and its line map for the lines where they are then."""
    begins = set(instruction_lines(dockerfile.text))
    lines: list[str] = []
    places: dict[int, Location] = {}
    new_stage = False
    for number, line in enumerate(dockerfile.text.rstrip("\n").split("\n"), 1):
        if number in begins:
            lines += [MARK] * new_stage
            new_stage = bool(_FROM.match(line))
        lines.append(line)
        if number in dockerfile.lines:
            places[len(lines)] = dockerfile.lines[number]
    text = "\n".join([*lines, *[MARK] * new_stage, UNMARK]) + "\n"
    return Dockerfile(text=text, lines=places, base=dockerfile.base, pinned=dockerfile.pinned)
