"""`$VAR`, `${VAR}` and `${VAR:-default}` in text -> text, as Compose puts variables in.

Takes text and what variables are worth; gives text, and records each variable that was asked for. Pure: nothing is
taken from the environment of this process. What Compose would take from there is a problem, unless it has a default.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.compose.origins import Both, Origin
from srprov.importing.normal import Refused, Variable
from srprov.importing.position import Position

_NAME = "[_a-zA-Z][_a-zA-Z0-9]*"
_FOUND = re.compile(rf"\$(?:(?P<escaped>\$)|(?P<named>{_NAME})|\{{)")
_HEAD = re.compile(rf"(?P<name>{_NAME})(?P<sign>:?[-+?])?")
_BRACES = re.compile(r"\{.?|\}+", re.DOTALL)
LONGEST_TEXT = 65_536
"""Of one text with variables in it, in characters."""
DEEPEST = 20
"""Defaults within defaults."""
LARGEST_RESULT = 4 * 1024 * 1024
"""Of all texts of a project together, once variables are put in."""
MOST_VARIABLES = 20_000
MOST_LOOKED_AT = 1024 * 1024 * 1024
"""Characters, of all texts of a project together: what follows a variable is looked at once more for each."""

MOST_BRACES = 500_000
"""Of all texts of a project together that have variables in braces."""


@dataclass
class Variables:
    """What variables are worth, and which were asked for."""

    worth: Mapping[str, Origin]
    used: list[Variable] = field(default_factory=list)
    problems: list[Diagnostic] = field(default_factory=list)
    size: list[int] = field(default_factory=lambda: [0, 0, 0])
    """How much text there is by now, and was looked at, and how many braces; one list for all that read one project."""

    def beside(self, more: Mapping[str, Origin]) -> Variables:
        """Return variables that know more names, for an included project; what is asked for is recorded here too."""
        return Variables(Both(self.worth, more), self.used, self.problems, self.size)

    def put_in(self, text: str, at: Position) -> str:
        """Return a text with its variables put in; what is wrong is added to `problems`.

        Raises:
            Refused: It is so long, or so deep, that nobody means it.
        """
        if "$" not in text:
            return text
        if len(text) > LONGEST_TEXT:
            raise Refused(
                [
                    Diagnostic(
                        at, f"a text with '$' in it has more than {LONGEST_TEXT} characters", code=Code.COMPOSE_VARIABLE
                    )
                ]
            )
        result = _Text(self, at, text).put_in(0, len(text), 0)
        self.grow(len(result), at)
        return result

    def grow(self, size: int, at: Position) -> None:
        """Count text that came out.

        Raises:
            Refused: It is too much.
        """
        self.size[0] += size
        if self.size[0] > LARGEST_RESULT:
            message = f"with its variables put in, the project is larger than {LARGEST_RESULT >> 20} MiB"
            raise Refused([Diagnostic(at, message, code=Code.COMPOSE_VARIABLE)])

    def look(self, size: int, at: Position) -> None:
        """Count text that is looked through for one variable.

        Raises:
            Refused: It is too much.
        """
        self.size[1] += size
        if self.size[1] > MOST_LOOKED_AT:
            raise Refused(
                [Diagnostic(at, "the project has too many variables in long texts", code=Code.COMPOSE_VARIABLE)]
            )

    def count_braces(self, text: str, at: Position) -> None:
        """Count braces that are looked at one by one.

        Raises:
            Refused: They are too many.
        """
        self.size[2] += text.count("{") + text.count("}")
        if self.size[2] > MOST_BRACES:
            message = f"texts with variables have more than {MOST_BRACES} braces"
            raise Refused([Diagnostic(at, message, code=Code.COMPOSE_VARIABLE)])

    def record(self, name: str, source: str, value: str, at: Position) -> None:
        """Note that a variable was asked for."""
        if len(self.used) >= MOST_VARIABLES:
            raise Refused(
                [
                    Diagnostic(
                        at, f"variables are asked for at more than {MOST_VARIABLES} places", code=Code.COMPOSE_VARIABLE
                    )
                ]
            )
        self.used.append(Variable(name, source, value, at))


class _Text:
    """One text at one place, with parts of it from one index to another: defaults, and defaults within these."""

    def __init__(self, variables: Variables, at: Position, text: str) -> None:
        self.variables = variables
        self.at = at
        self.text = text

    @functools.cached_property
    def closing(self) -> dict[int, int]:
        """Where each brace closes: looked for once, however deep defaults are nested."""
        self.variables.count_braces(self.text, self.at)
        return _closing(self.text)

    def put_in(self, begin: int, end: int, depth: int) -> str:
        if depth > DEEPEST:
            raise Refused(
                [
                    Diagnostic(
                        self.at,
                        f"defaults of variables are nested more than {DEEPEST} deep",
                        code=Code.COMPOSE_VARIABLE,
                    )
                ]
            )
        done: list[str] = []
        while found := _FOUND.search(self.text, begin, end):
            self.variables.look(end - begin, self.at)
            done.append(self.text[begin : found.start()])
            value, begin = self._one(found, begin, end, depth)
            done.append(value)
            self.variables.grow(len(value), self.at)
        return "".join([*done, self.text[begin:end]])

    def _one(self, found: re.Match[str], begin: int, end: int, depth: int) -> tuple[str, int]:
        """Return one variable's value, and where what is left of the text begins."""
        after = found.end()
        if found["escaped"]:
            return "$", after
        if found["named"]:
            return self._plain(found["named"]), after
        head = _HEAD.match(self.text, after, end)
        # Compose takes all up to the last brace of the line, and then goes back to the brace that closes this one
        if head is None or (last := self._last_brace(head, end)) < 0:
            return self._broken(self.text[begin : min(end, begin + 80)]), after
        last = min(self.closing.get(after - 1, last), last)
        name, sign = head.groups()
        if sign:
            return self._signed(name, sign, (head.end(), last), depth), last + 1
        return self._plain(name), last + 1

    def _last_brace(self, head: re.Match[str], end: int) -> int:
        """Return where a variable may end at the latest, by its name and perhaps sign; or -1."""
        after = head.end()
        if not head["sign"]:
            return after if self.text.startswith("}", after, end) else -1
        line = self.text.find("\n", after, end)
        return self.text.rfind("}", after, line if line >= 0 else end)

    def _broken(self, text: str) -> str:
        hint = "write '$$' for a dollar sign"
        self.variables.problems.append(
            Diagnostic(self.at, f"no variable is written like this: '{text}'", "", "", hint, code=Code.COMPOSE_VARIABLE)
        )
        return ""

    def _plain(self, name: str) -> str:
        known = self.variables.worth.get(name)
        if known is None:
            self.variables.record(name, "unset", "", self.at)
            message = f"the variable {name} has no value; nothing is taken from this machine's environment"
            self.variables.problems.append(
                Diagnostic(self.at, message, "", "", f"give one: --set {name}=VALUE", code=Code.COMPOSE_VARIABLE)
            )
            return ""
        return self._known(name, known)

    def _known(self, name: str, known: Origin) -> str:
        self.variables.record(name, known.source, known.value, self.at)
        return known.value

    def _signed(self, name: str, sign: str, span: tuple[int, int], depth: int) -> str:
        known = self.variables.worth.get(name)
        usable = known is not None and (bool(known.value) or not sign.startswith(":"))
        word = self.put_in(*span, depth + 1)
        if sign.endswith("+"):
            value = word if usable else ""
            self.variables.record(name, known.source if known else "unset", value, self.at)
            return value
        if known is not None and usable:
            return self._known(name, known)
        if sign.endswith("-"):
            self.variables.record(name, "default", word, self.at)
            return word
        self.variables.record(name, "unset", "", self.at)
        message = f"the variable {name} is required" + (f": {word[:200]}" if word else "")
        self.variables.problems.append(
            Diagnostic(self.at, message, "", "", f"give one: --set {name}=VALUE", code=Code.COMPOSE_VARIABLE)
        )
        return ""


def _closing(text: str) -> dict[int, int]:
    """Return where braces open -> where they close; as in Compose, an opening one hides the character after it.

    Where the first variable stands does not matter: what comes before `${` hides nothing behind it.
    """
    opened: list[int] = []
    closing: dict[int, int] = {}
    for found in _BRACES.finditer(text):
        if text[found.start()] == "{":
            opened.append(found.start())
            continue
        for index in range(found.start(), min(found.end(), found.start() + len(opened))):
            closing[opened.pop()] = index
    return closing
