"""A Dockerfile -> what srprov must know of it: whether it is one, and whether its image has a healthcheck.

Takes the text; gives instructions with their lines. Pure. Nothing is expanded; Docker itself builds it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.definitions import images
from srprov.errors import Diagnostic, Location

_FROM = re.compile(r"(?:--\S+\s+)*(?P<image>\S+)(?:\s+as\s+(?P<name>\S+))?", re.IGNORECASE)
MAX_BYTES = 128 * 1024
_EXPANDED = re.compile(r"[$\"'\\`]")
"""What the builder takes for variables, quotes or escapes in an image's name."""
_FROM_LINE = re.compile(rf"\s*(?:ONBUILD\s+)*FROM\s+{_FROM.pattern}\s*", re.IGNORECASE)
_FROM_OPTION = re.compile(r"\s--from=(\S+)")
_ADD_LINE = re.compile(r"\s*(?:ONBUILD\s+)*ADD\b(?P<what>.*)", re.IGNORECASE)
_LOCAL = re.compile(r"[\w./ \t\"\[\],=*?@+:-]*", re.ASCII)
"""What cannot be a URL once `://` is not in it: no variable and no escape."""
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


def images_of(text: str) -> tuple[str, ...]:
    """Return the images that any reading of the text starts from or takes files of, as written, sorted."""
    found: set[str] = set()
    for lines in _readings(text):
        stages = {"scratch"}
        for line in lines:
            if start := _FROM_LINE.match(line):
                if start["image"].lower() not in {*stages, "\\", "`"}:
                    found.add(start["image"])
                stages.add((start["name"] or "").lower())
            for name in _FROM_OPTION.findall(line):
                if name.lower() not in stages and not name.isdigit():
                    found.add(name)
    return tuple(sorted(found))


def fetches(text: str) -> tuple[str, ...]:
    """Return what any reading of the text ADDs that is not surely a file of the build's context, sorted.

    A classic build's engine fetches a URL itself, in the robot's own network: its loopback, its metadata service.
    """
    added = {match["what"].strip() for lines in _readings(text) for line in lines if (match := _ADD_LINE.match(line))}
    return tuple(sorted(what for what in added if not _LOCAL.fullmatch(what) or "://" in what or "git@" in what))


def _readings(text: str) -> Iterator[list[str]]:
    """Yield the lines as a builder may join them: at backslashes or, as `# escape` can say, at backticks.

    Here-documents are not left out: the engine's classic builder takes their lines for instructions.
    """
    whole = text.lstrip("\ufeff").replace("\r\n", "\n")
    for joint in ("\\\\", "`"):
        yield re.sub(rf"{joint}[ \t]*\n(?:[ \t]*(?:#[^\n]*)?\n)*", "", whole).splitlines()


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
