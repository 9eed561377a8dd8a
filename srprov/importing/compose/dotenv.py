"""Files of variables, `.env` and those of `env_file`, read by Compose's rules of quotes.

Takes text and what is known already; gives names with their values and lines. Pure.

A value without quotes ends at ` #`, is trimmed, and variables are put in. In double quotes there may be escapes and
line ends, and variables are put in; in single quotes everything stays. A name without `=` asks for a
variable that is known.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import msgspec

from srprov.codes import Code
from srprov.definitions.envfile import BEHIND
from srprov.errors import Diagnostic
from srprov.importing.normal import Refused
from srprov.importing.position import Position

_SPACE = r"\t\v\f\r \x85\xa0"
_SPACES = re.compile(f"[{_SPACE}]*")
_BETWEEN = re.compile(r"\s*(#[^\n]*)?")
_OF_NAMES = re.compile(rf"[\w.\-\[\]{_SPACE}]*")
_CLOSING = {quote: re.compile(rf"(?<!\\){quote}") for quote in "'\""}
_ESCAPE = re.compile(r"""\\(?:([abcfnrtv$"\\])|0([0-9]{0,3}))""", re.ASCII)
_PLAIN_ESCAPES = {"a": "\a", "b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "v": "\v", "\\": "\\", '"': '"'}
_EXPORT = re.compile(r"export\s+")
MOST_LINES = 10_000
"""Of a file, and of variables in it: several may stand in a line, behind each other's quotes."""
MOST_BACKSLASHES = 200_000
"""Of a file, in double quotes, where each may begin an escape."""


class Entry(msgspec.Struct, frozen=True):
    """One line: a name, and its value, or None for a name alone that nothing is known of."""

    name: str
    value: str | None
    at: Position


PutIn = Callable[[str, Position], str]
"""Puts variables into a text; it knows what the entries before said."""
Lookup = Callable[[str, Position], str | None]
"""Returns what is known of a variable by now."""


def raw(text: str, file: str, lookup: Lookup) -> Iterator[Entry]:
    """Yield the lines of a file whose values are taken as they are written (`format: raw`).

    Raises:
        Refused: A line has no name, or there are too many.
    """
    for number, line in enumerate(text.splitlines(), 1):
        at = Position(file, number, 1)
        if number > MOST_LINES:
            many = f"there are more than {MOST_LINES} lines"
            raise Refused([Diagnostic(at, many, code=Code.COMPOSE_VARIABLE)])
        bare = line.lstrip()
        if not bare or bare.startswith("#"):
            continue
        name, sign, value = bare.partition("=")
        if not name or any(space in name for space in " \t"):
            raise Refused([Diagnostic(at, f"'{name[:80]}' is no name of a variable", code=Code.COMPOSE_VARIABLE)])
        yield Entry(name, value if sign else lookup(name, at), at)


def read(text: str, file: str, put_in: PutIn, lookup: Lookup) -> Iterator[Entry]:
    """Yield the entries of a file, in order.

    Raises:
        Refused: A name has a character that none may have, or a quote is not closed.
    """
    source = _Source(text, file)
    while (entry := source.entry(put_in, lookup)) is not None:
        yield entry


class _Source:
    """A file that is read from its beginning to its end."""

    def __init__(self, text: str, file: str) -> None:
        self.text = text
        self.file = file
        self.at = 0
        self.closed: int | None = None
        """Where the last quoted value ended."""
        self.lines, self.counted, self.line = 1, 0, 0
        """The line that has been reached, up to where it was looked for, and where it begins."""
        self.entries = 0
        self.backslashes = 0

    def here(self) -> Position:
        """Return the place that has been reached; only what is new since the last call is looked at."""
        self.lines += self.text.count("\n", self.counted, self.at)
        self.line = self.text.rfind("\n", self.counted, self.at) + 1 or self.line
        self.counted = self.at
        if self.lines > MOST_LINES or self.entries > MOST_LINES:
            many = f"there are more than {MOST_LINES} {'lines' if self.lines > MOST_LINES else 'variables'}"
            raise Refused([Diagnostic(Position(self.file, self.lines), many, code=Code.COMPOSE_VARIABLE)])
        return Position(self.file, self.lines, self.at - self.line + 1)

    def entry(self, put_in: PutIn, lookup: Lookup) -> Entry | None:
        """Read the next name and its value; None at the end."""
        while self._skip(_BETWEEN)[1]:
            self.here()
        if self.at == len(self.text):
            return None
        self.entries += 1
        at = self.here()
        name, alone = self._name(at)
        if alone:
            return Entry(name, lookup(name, at), at)
        return Entry(name, self._worth(at, put_in), at)

    def _skip(self, what: re.Pattern[str]) -> re.Match[str]:
        found = what.match(self.text, self.at)
        assert found  # also without a character
        self.at = found.end()
        return found

    def _name(self, at: Position) -> tuple[str, bool]:
        if export := _EXPORT.match(self.text, self.at):
            self.at = export.end()
        begin = self.at
        behind = self.closed is not None and self.text.find("\n", self.closed, begin) < 0
        hint = BEHIND if behind else ""
        self._skip(_OF_NAMES)
        end, sign = self.at, self.text[self.at : self.at + 1]
        if sign not in "=:\n":
            message = f"a name of a variable has no '{sign}'"
            message += ", and what stands behind a closing quote is one for Compose" if behind else ""
            raise Refused([Diagnostic(at, message, hint=hint, code=Code.COMPOSE_VARIABLE)])
        name = self.text[begin:end].rstrip()
        if " " in name:
            message = f"the name of a variable has a space: '{name[:80]}'"
            raise Refused([Diagnostic(at, message, hint=hint, code=Code.COMPOSE_VARIABLE)])
        self.at = min(end + 1, len(self.text))
        if sign != "\n":
            self._skip(_SPACES)
        return name, sign == "\n" or not sign

    def _worth(self, at: Position, put_in: PutIn) -> str:
        quote = self.text[self.at : self.at + 1]
        if quote not in ("'", '"'):
            end = self.text.find("\n", self.at)
            end = len(self.text) if end < 0 else end
            line = self.text[self.at : end].partition(" #")[0].rstrip()
            self.at = min(end + 1, len(self.text))
            return put_in(line, at)
        begin = self.at + 1
        if (closing := _CLOSING[quote].search(self.text, begin)) is None:
            raise Refused([Diagnostic(at, "a quote is not closed", code=Code.COMPOSE_VARIABLE)])
        self.at = self.closed = closing.end()
        value = self.text[begin : closing.start()]
        return value.replace("\\'", "'") if quote == "'" else put_in(self._unescaped(value, at), at)

    def _unescaped(self, value: str, at: Position) -> str:
        self.backslashes += value.count("\\")
        if self.backslashes > MOST_BACKSLASHES:
            many = f"there are more than {MOST_BACKSLASHES} backslashes"
            raise Refused([Diagnostic(at, many, code=Code.COMPOSE_VARIABLE)])
        return _ESCAPE.sub(_escaped, value)


def _escaped(found: re.Match[str]) -> str:
    if found[1] == "$":
        return "$$"
    if found[1]:
        return _PLAIN_ESCAPES.get(found[1], found[0])
    digits = found[2]
    return chr(int(digits, 8)) if re.fullmatch("[0-3][0-7]{2}", digits) else "\\" + digits
