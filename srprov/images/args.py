"""Values for the ARG instructions of a Dockerfile, and digests of its images, written into it.

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


def with_digests(text: str, pins: Mapping[str, str]) -> str:
    """Return a Dockerfile that names images by their digests; stages that are called like an image are left alone.

    Args:
        text: The Dockerfile.
        pins: Name as it stands there -> name by digest.
    """
    lines, stages = text.split("\n"), set[str]()
    for start, word, rest in instructions(text) if pins else ():
        if word not in ("FROM", "COPY", "ADD"):
            continue
        end, image = _end(lines, start), next((one for one in rest.split() if not one.startswith("--")), "")
        for name, digest in pins.items():
            before = r"(?<!\S)" if word == "FROM" else "(?<=--from=)"
            found = re.compile(rf"{before}{re.escape(name)}(?!\S)")
            named = image == name if word == "FROM" else f"--from={name}" in rest.split()
            at = next((number for number in range(start - 1, end) if found.search(lines[number])), None)
            if named and name.lower() not in stages and at is not None:
                lines[at] = found.sub(digest, lines[at], count=1)
        if word == "FROM" and len(words := rest.split()) > 2 and words[-2].lower() == "as":
            stages.add(words[-1].lower())
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
