r"""`env_file` -> variables, in the syntax that Docker Compose reads.

Takes a file's text; gives names and values in order, or problems at their lines. Pure. `NAME=value`, comments,
`export`, single quotes (literal, may span lines) and double quotes (with \n, \t, \", \\). `${…}` stays as it is
written: nothing is interpolated.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from srprov.errors import Diagnostic, Location

_NAME = re.compile(r"(?:export\s+)?(?P<name>[A-Za-z_][A-Za-z0-9_.-]*)\s*(?P<sign>[=:]?)[ \t]*")
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", '"': '"', "\\": "\\", "$": "$"}


def parse(text: str, file: str, environ: Mapping[str, str]) -> tuple[dict[str, str], set[str], list[Diagnostic]]:
    """Read every variable; a bare NAME takes its value from `environ` and is left out where that has none.

    Returns:
        Names with values; the names whose value is `environ`'s; and what is wrong.
    """
    found: dict[str, str] = {}
    bare_names: set[str] = set()
    problems: list[Diagnostic] = []
    lines = text.splitlines()
    number = 0
    while number < len(lines):
        line, start = lines[number], number + 1
        number += 1
        bare = line.strip()
        if not bare or bare.startswith("#"):
            continue
        match = _NAME.match(line.lstrip())
        column = len(line) - len(line.lstrip()) + 1
        if match is None or (not match["sign"] and line.lstrip()[match.end() :].strip()):
            place = Location(file, start, column)
            problems.append(Diagnostic(place, "is not NAME=value", "", line, "a name has letters, digits and '_'"))
            continue
        if not match["sign"]:
            if match["name"] in environ:
                found[match["name"]] = environ[match["name"]]
                bare_names.add(match["name"])
            continue
        bare_names.discard(match["name"])
        rest = line.lstrip()[match.end() :]
        if rest[:1] in ("'", '"'):
            while (end := _end_of_quote(rest)) < 0 and number < len(lines):
                rest += "\n" + lines[number]
                number += 1
            if end < 0:
                place = Location(file, start, column + match.end())
                problems.append(Diagnostic(place, "the quote is not closed", "", line))
                continue
            inner = rest[1:end]
            found[match["name"]] = inner if rest[0] == "'" else re.sub(r"\\(.)", _unescape, inner, flags=re.DOTALL)
        else:
            found[match["name"]] = re.split(r"(?:^|\s)#", rest, maxsplit=1)[0].strip()
    return found, bare_names, problems


def _end_of_quote(text: str) -> int:
    """Return the index of the closing quote of a text that begins with one, or -1."""
    position = 1
    while position < len(text):
        if text[position] == "\\" and text[0] == '"':
            position += 2
        elif text[position] == text[0]:
            return position
        else:
            position += 1
    return -1


def _unescape(match: re.Match[str]) -> str:
    return _ESCAPES.get(match[1], match[0])
