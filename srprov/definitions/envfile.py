r"""`env_file` -> variables, in the syntax that Docker Compose reads.

Takes a file's text; gives names and values in order, or problems at their lines. Pure. `NAME=value`, comments,
`export`, single quotes (literal, may span lines) and double quotes (with \n, \t, \", \\). `${…}` stays as it is
written: nothing is interpolated.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from srprov.codes import Code
from srprov.errors import Diagnostic, Location

_NAME = re.compile(r"(?:export\s+)?(?P<name>[A-Za-z_][A-Za-z0-9_.-]*)\s*(?P<sign>[=:]?)[ \t]*")
MAX_BYTES = 256 * 1024
_MOST_PROBLEMS = 100
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
    while number < len(lines) and len(problems) <= _MOST_PROBLEMS:
        line, start = lines[number], number + 1
        number += 1
        bare = line.strip()
        if not bare or bare.startswith("#"):
            continue
        match = _NAME.match(line.lstrip())
        column = len(line) - len(line.lstrip()) + 1
        if match is None or (not match["sign"] and line.lstrip()[match.end() :].strip()):
            place = Location(file, start, column)
            problems.append(
                Diagnostic(
                    place, "is not NAME=value", "", line, "a name has letters, digits and '_'", code=Code.ENVIRONMENT
                )
            )
            continue
        if not match["sign"]:
            if match["name"] in environ:
                found[match["name"]] = environ[match["name"]]
                bare_names.add(match["name"])
            continue
        bare_names.discard(match["name"])
        rest = line.lstrip()[match.end() :]
        if rest[:1] in ("'", '"'):
            rest, end, number = _quoted(rest, lines, number)
            if end < 0:
                place = Location(file, start, column + match.end())
                problems.append(Diagnostic(place, "the quote is not closed", "", line, code=Code.ENVIRONMENT))
                continue
            inner = rest[1:end]
            found[match["name"]] = inner if rest[0] == "'" else re.sub(r"\\(.)", _unescape, inner, flags=re.DOTALL)
        else:
            found[match["name"]] = re.split(r"(?:^|\s)#", rest, maxsplit=1)[0].strip()
    return found, bare_names, problems


def _quoted(rest: str, lines: Sequence[str], number: int) -> tuple[str, int, int]:
    """Return a quoted text with the lines that it goes on in, where its quote ends (or -1), and the line after it."""
    pieces, end = [rest], _end_of_quote(rest, rest[0], 1)
    while end < 0 and number < len(lines):
        # a backslash at the end of a line escapes the line's end, nothing of the next one
        inside = _end_of_quote(lines[number], rest[0], 0)
        end = inside if inside < 0 else sum(len(one) + 1 for one in pieces) + inside
        pieces.append(lines[number])
        number += 1
    return "\n".join(pieces), end, number


def _end_of_quote(text: str, quote: str, position: int) -> int:
    """Return the index of the first quote from a position on that is not escaped, or -1."""
    while position < len(text):
        if text[position] == "\\" and quote == '"':
            position += 2
        elif text[position] == quote:
            return position
        else:
            position += 1
    return -1


def _unescape(match: re.Match[str]) -> str:
    return _ESCAPES.get(match[1], match[0])
