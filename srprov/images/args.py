"""Values for the ARG instructions of a Dockerfile, and digests of its images, written into it.

Takes a Dockerfile's text and values; gives the text. Pure. So what is built follows from the build context alone: the
content tag covers the values, and a plan from a file needs nothing beside it. They are in the image's history, and so
no place for secrets.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from srprov.definitions.dockerfile import OPTIONS, instructions
from srprov.images import quoting

_WORD = re.compile(r"(?:[^\s\"'\\]|\"[^\"\\]*\"|'[^']*')+")
_CONTINUED = re.compile(r"(?<!\\)\\[ \t\r]*\Z")
_FIRST = re.compile(r"(\S+)(\s*)")
_FROM_OPTION = re.compile(r"((?:(?<!\S)--from=|(?<!\S)--mount=(?:\S*,)?(?i:from)=))([^\s,]+)")
"""What an option takes files of: of a mount the last `from` counts."""


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

    An instruction that names one stands on one line then, where no comment within it can be taken for the name.

    Args:
        text: The Dockerfile.
        pins: Name as it stands there -> name by digest.
    """
    lines, stages, own = text.split("\n"), set[str](), ""
    for start, word, rest in instructions(text) if pins else ():
        if word == "FROM":
            stages.add(own)  # within a stage its own name is still that of an image
        new = _named(word, rest, lambda name: name if name.lower() in stages else pins.get(name, name))
        if new != rest:
            end = _end(lines, start)
            lines[start - 1 : end] = [f"{word} {new}", *[""] * (end - start)]
        if word == "FROM":
            words = rest.split()
            own = words[-1].lower() if len(words) > 2 and words[-2].lower() == "as" else ""
    return "\n".join(lines)


def _named(word: str, rest: str, digest: Callable[[str], str]) -> str:
    """Return what stands behind an instruction's word, with digests of the images that it takes something of."""
    if word == "ONBUILD" and (match := _FIRST.match(rest)):
        return match[0] + _named(match[0].strip().upper(), rest[match.end() :], digest)
    options = OPTIONS.match(rest)
    at = options.end() if options else 0
    if word == "FROM":
        return rest[:at] + _FIRST.sub(lambda one: digest(one[1]) + one[2], rest[at:], count=1)
    if word not in ("COPY", "ADD", "RUN"):
        return rest
    return _FROM_OPTION.sub(lambda one: one[1] + digest(one[2]), rest[:at]) + rest[at:]


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
