r"""`env_file` -> variables, in the syntax that Docker Compose reads.

Takes a file's text; gives names and values in order, or problems at their lines. Pure. `NAME=value`, comments,
`export`, single quotes (literal but for \', may span lines) and double quotes (with \n, \t, \", \\). `${…}` stays as
it is written: nothing is interpolated. Behind a closing quote there is nothing but a comment: Compose takes a name
there for the next variable, and refuses all else.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from srprov.codes import Code
from srprov.errors import Diagnostic, Location

_NAME = re.compile(r"(?:export\s+)?(?P<name>[A-Za-z_][A-Za-z0-9_.-]*)\s*(?P<sign>[=:]?)[ \t]*")
BEHIND = """write the whole value in one pair of quotes, as in "it's", or without any; a comment begins with #"""
"""What to do where something stands behind a closing quote."""
_ESCAPED = re.compile(r"\\(.)", re.DOTALL)
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
            value, number = _quoted(rest, lines, number, Location(file, start, column + match.end()))
            if isinstance(value, Diagnostic):
                problems.append(value)
            else:
                found[match["name"]] = value
        else:
            found[match["name"]] = re.split(r"(?:^|\s)#", rest, maxsplit=1)[0].strip()
    return found, bare_names, problems


def _quoted(rest: str, lines: Sequence[str], number: int, at: Location) -> tuple[str | Diagnostic, int]:
    """Return the value of a quoted text that begins there, or what is wrong with it, and the line after it."""
    text, end, number = _to_its_end(rest, lines, number)
    if end < 0:
        return Diagnostic(at, "the quote is not closed", "", lines[at.line - 1], code=Code.ENVIRONMENT), number
    behind, last = text[end + 1 :].lstrip(), lines[number - 1]
    if found := behind.partition("#")[0].rstrip():
        place = Location(at.file, number, len(last) - len(behind) + 1)
        message = f"'{found[:80]}' stands behind the closing quote"
        return Diagnostic(place, message, "", last, BEHIND, code=Code.ENVIRONMENT), number
    escapes = _ESCAPES if text[0] == '"' else {"'": "'"}
    return _ESCAPED.sub(lambda one: escapes.get(one[1], one[0]), text[1:end]), number


def _to_its_end(rest: str, lines: Sequence[str], number: int) -> tuple[str, int, int]:
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
        if text[position] == "\\":
            position += 2
        elif text[position] == quote:
            return position
        else:
            position += 1
    return -1
