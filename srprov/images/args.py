"""Values for the ARG instructions of a Dockerfile, written into it.

Takes a Dockerfile's text and values; gives the text. Pure. So what is built follows from the build context alone: the
content tag covers the values, and a plan from a file needs nothing beside it. They are in the image's history, and so
no place for secrets.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from srprov.definitions.dockerfile import instructions
from srprov.images import quoting

_WORD = re.compile(r"(?:[^\s\"'\\]|\"[^\"\\]*\"|'[^']*')+")
_CONTINUED = re.compile(r"(?<!\\)\\[ \t\r]*\Z")


def with_args(text: str, args: Mapping[str, str]) -> str:
    """Return a Dockerfile in which each ARG of these names has its value as default; lines keep their numbers.

    Raises:
        ValueError: A value has a line break, or an ARG is written in a way that cannot be read for sure.
    """
    if not args:
        return text
    lines = text.split("\n")
    for start, word, rest in instructions(text):
        if word != "ARG":
            continue
        words = _WORD.findall(rest)
        names = [one.partition("=")[0] for one in words]
        if not args.keys() & set(re.split(r"[\s=]+", rest)):
            continue
        if _WORD.sub("", rest).strip():
            raise ValueError(f"line {start} of the Dockerfile: write one ARG for each name, to give it a value")
        given = [
            quoting.variable(name, args[name]) if name in args else one for name, one in zip(names, words, strict=True)
        ]
        end = _end(lines, start)
        lines[start - 1 : end] = [f"ARG {' '.join(given)}", *[""] * (end - start)]
    return "\n".join(lines)


def _end(lines: list[str], start: int) -> int:
    """Return the last line, from 1, of the instruction that begins at `start`; comments in between belong to it."""
    end = start
    while end < len(lines):
        line = lines[end - 1]
        within = end > start and (not line.strip() or line.strip().startswith("#"))
        if not within and not _CONTINUED.search(line):
            break
        end += 1
    return end
