"""Words of a Dockerfile's instructions: lists, and names of ARG that a builder has a meaning of its own for. Pure."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable

_PROXIES = ("http_proxy", "https_proxy", "ftp_proxy", "no_proxy", "all_proxy")
_WORD = re.compile(r"(?:[^\s\"'\\]|\"[^\"\\]*\"|'[^'\\]*')+")
_BUILDERS_OWN = "#(nop)"
"""How the command begins by which the classic builder knows the layer of a COPY, an ENV or a LABEL."""
_CODE = re.compile(r"\\u([0-9A-Fa-f]{4})")
_NAME = re.compile("[A-Za-z_][A-Za-z0-9_.-]*")
KNOWN = frozenset(
    {"ADD", "ARG", "CMD", "COPY", "ENTRYPOINT", "ENV", "EXPOSE", "FROM", "HEALTHCHECK", "LABEL", "MAINTAINER",
     "ONBUILD", "RUN", "SHELL", "STOPSIGNAL", "USER", "VOLUME", "WORKDIR"}
)  # fmt: skip
"""Instructions; another one may be the text of a line before."""
TRIGGERED = KNOWN - {"FROM", "MAINTAINER", "ONBUILD"}
"""Those that builders take behind ONBUILD."""
STAGE = re.compile("[a-z][a-z0-9_.-]*", re.IGNORECASE | re.ASCII)
"""A stage's name as builders take it: no image of an experiment has one. Source: buildkit, instructions/parse.go."""
_MOST_LINES, _MOST_INSTRUCTIONS = 5000, 1000
"""An image has 127 layers at most. All are gone through in each reading, and some for each name."""


def beyond(lines: int, begins: Iterable[int]) -> tuple[int, str] | None:
    """Return the first line of a Dockerfile that is not read any more, and why; None where it is short enough."""
    if lines > _MOST_LINES:
        return _MOST_LINES, f"more follow, and no more than {_MOST_LINES} are read"
    more = next(itertools.islice(begins, _MOST_INSTRUCTIONS, None), 0)
    return (more, f"no more than {_MOST_INSTRUCTIONS} instructions are read") if more else None


def is_split(instruction: str, line: str) -> bool:
    """Return whether the word of an instruction goes on in another line than its first one."""
    return line.lstrip(" \t")[: len(instruction) + 1].upper().rstrip(" \t\\") != instruction


def triggered(instruction: str, words: str) -> tuple[str, str]:
    """Return an instruction and its words; of ONBUILD those behind it, of which builders take one that is none."""
    if instruction != "ONBUILD" or not words:
        return instruction, words
    first, *others = words.split(None, 1)
    return first.upper(), " ".join(others)


def is_list(words: str) -> bool:
    """Return whether words are a JSON list of texts, which Docker takes as they are."""
    try:
        value = json.loads(words) if words.startswith("[") else None
    except (ValueError, RecursionError):
        return False
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


def is_builders_own(command: str) -> bool:
    """Return whether the classic builder may take a RUN for another instruction when it looks for a layer.

    It would be in the place of that one in another experiment's image, which then lacks what is copied there.
    """
    return _BUILDERS_OWN in command or _BUILDERS_OWN in _CODE.sub(lambda match: chr(int(match[1], 16)), command)


def hidden_proxy(instructions: Iterable[tuple[int, str, str]]) -> int:
    """Return the line of an ARG before all stages that is a proxy, or that may be one; 0 where there is none.

    The classic builder gives a proxy of there to each RUN, and leaves it out of what it knows the layer by. So one that
    came through it would be taken for the same step of another experiment. In a stage it counts.
    """
    for number, instruction, rest in instructions:
        if instruction == "FROM":
            return 0
        names = [word.partition("=")[0] for word in _WORD.findall(rest)] if instruction == "ARG" else []
        plain = all(map(_NAME.fullmatch, names)) and not (names and _WORD.sub("", rest).strip())
        if not plain or any(name.lower() in _PROXIES for name in names):
            return number
    return 0
