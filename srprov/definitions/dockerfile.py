"""A Dockerfile -> what srprov must know of it: whether it is one, and whether its image has a healthcheck.

Takes the text; gives instructions with their lines. Pure. Nothing is expanded; Docker itself builds it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.definitions import images
from srprov.errors import Diagnostic, Location

_FROM = re.compile(r"(?:--\S+\s+)*(?P<image>\S+)(?:\s+as\s+(?P<name>\S+))?", re.IGNORECASE)
_EXPANDED = re.compile(r"[$\"'\\`]")
"""What the builder takes for variables, quotes or escapes in an image's name."""
_HEREDOC = re.compile(r"<<-?([\"']?)([A-Za-z_][A-Za-z0-9_]*)\1")


def is_dockerfile(path: str) -> bool:
    """Return whether a path is a Dockerfile, by its name: `…Dockerfile` or `*.dockerfile`."""
    name = path.rsplit("/", 1)[-1]
    return name.endswith("Dockerfile") or name.startswith("Dockerfile.") or name.endswith(".dockerfile")


def instructions(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield (line, INSTRUCTION, rest) with continued lines joined, comments and here-documents left out."""
    start, joined, ends = 0, "", []  # type: int, str, list[str]
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.strip()
        if ends:
            if bare == ends[0]:
                ends.pop(0)
            continue
        if not bare or bare.startswith("#"):
            continue
        start = start or number
        if bare.endswith("\\"):
            joined += bare[:-1] + " "
            continue
        word, _, rest = (joined + bare).strip().partition(" ")
        if word.upper() in ("RUN", "COPY", "ADD"):
            ends = [match[2] for match in _HEREDOC.finditer(rest)]
        yield start, word.upper(), rest.strip()
        start, joined = 0, ""


def has_healthcheck(text: str) -> bool:
    """Return whether the last stage, or an earlier stage that it is built from, sets a healthcheck."""
    by_stage: dict[str, bool] = {}
    name, found = "", False
    for _, word, rest in instructions(text):
        match = _FROM.fullmatch(rest) if word == "FROM" else None
        if match is not None:
            found, name = by_stage.get(match["image"].lower(), False), (match["name"] or "").lower()
        elif word == "HEALTHCHECK":
            found = rest.strip().upper() != "NONE"
        by_stage[name] = found
    return found


def check(text: str, shown: str) -> list[Diagnostic]:
    """Return what is wrong with a Dockerfile as far as srprov can tell."""
    lines = text.splitlines()
    first = next(((number, word, rest) for number, word, rest in instructions(text) if word != "ARG"), None)
    if first is None:
        return [Diagnostic(Location(shown), "holds no instruction", hint="a Dockerfile begins with FROM")]
    number, word, rest = first
    excerpt = lines[number - 1]
    place = Location(shown, number, len(excerpt) - len(excerpt.lstrip()) + 1)
    if word != "FROM":
        return [Diagnostic(place, f"a Dockerfile begins with FROM, not {word[:40]}", "", excerpt)]
    if not rest:
        return [Diagnostic(place, "FROM needs an image", "", excerpt)]
    return _wrong_bases(text, shown)


def _wrong_bases(text: str, shown: str) -> list[Diagnostic]:
    """Return every FROM whose image cannot be one; what holds a variable or quotes is left to the builder."""
    lines = text.splitlines()
    stages = {"scratch"}
    found = []
    for number, word, rest in instructions(text):
        match = _FROM.fullmatch(rest) if word == "FROM" else None
        if match is None:
            continue
        image = match["image"]
        if image.lower() not in stages and not _EXPANDED.search(image) and (wrong := images.fault(image)):
            at = next((line for line in range(number, len(lines) + 1) if image in lines[line - 1]), number)
            place = Location(shown, at, lines[at - 1].find(image) + 1)
            found.append(Diagnostic(place, wrong, "", lines[at - 1], images.hint(image)))
        stages.add((match["name"] or "").lower())
    return found
