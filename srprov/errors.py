"""Every error that srprov raises on purpose.

    SrprovError                  the root; anything else that escapes is a bug (exit 1)
    ├─ UsageError                options or arguments that make no sense together (5)
    ├─ DefinitionError           user files; carries every Problem, not the first (5)
    ├─ RenderError               a playbook that does not render to resources (5)
    ├─ RefusedError              refused by policy, or by the user at the prompt (9)
    ├─ NoAssignment              no feasible placement; carries the reasons as data (8)
    ├─ LockHeld                  another controller holds the robot (7)
    ├─ StalePlan                 a robot moved since the plan was made (6)
    ├─ PlanError                 a cycle, or two resources with one id: a bug of a playbook (5)
    ├─ TransportError            one robot cannot be talked to (4); always a value per robot in the end
    │  ├─ ConnectError           name, TCP, banner or key exchange
    │  ├─ HostKeyError           unknown or changed host key
    │  ├─ AuthError              no key or password was accepted, or sudo asks for one
    │  └─ DeadlineError          an answer did not come in time
    └─ LabError                  the embedded lab (3)

Each message says what happened; `hint` says what to do next, and `code` which page explains it. A message may hold
a robot's words: further lines are indented, so that none passes for one of srprov's own. A TransportError has no hint
but srprov's, which stands in the line behind its only one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from srprov.codes import Code

_LONGEST_WORD = 80
_MOST_KNOWN = 64
"""Names that an unknown word is compared with."""
_FURTHER = re.compile(r"\n(?=\S)")


class SrprovError(Exception):
    """Root of the tree. `exit_code` is the documented one of the command line."""

    exit_code = 1

    def __init__(self, message: str, *, code: Code, hint: str = "") -> None:
        """Take one sentence on what happened and one on what to do next."""
        message = indented(message)
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.code = code

    @property
    def told(self) -> str:
        """The message with its code at the end of its first line, for lists of what several robots said."""
        return with_code(self.message, self.code)

    def __reduce__(self) -> tuple[object, ...]:
        """Say how to make the same error in another process: it is not what the constructor takes."""
        return _remade, (type(self), self.args), self.__dict__


def _remade(kind: type[SrprovError], arguments: tuple[object, ...]) -> SrprovError:
    return kind.__new__(kind, *arguments)


def indented(text: str) -> str:
    """Return a text whose further lines do not begin as one of srprov's own, also when nothing but them is printed."""
    return _FURTHER.sub("\n  ", "\n".join(visible(line) for line in text.split("\n")))


def with_code(message: str, code: Code) -> str:
    """Return a message with a code at the end of its first line."""
    first, *more = message.split("\n")
    return "\n".join([f"{first} [{code}]", *more])


def visible(text: str) -> str:
    """Return one printable line: what ends a line, moves the cursor or turns the writing around, by its number."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def one_line(text: str) -> str:
    """Return a text of several lines as one: a robot's second line would pass for a hint, a command to be copied."""
    return visible("; ".join(line for part in text.splitlines() if (line := part.strip())))


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `did you mean 'x'?` for the known word that is closest to the given one, or nothing."""
    import bisect  # only a mistake needs them
    import difflib
    import operator

    word, names = word[:_LONGEST_WORD], sorted(one for one in known if len(one) <= _LONGEST_WORD)
    if len(names) > _MOST_KNOWN:
        # a comparison takes long: only with those that begin alike, and those with the same letters at the same places
        at = bisect.bisect(names, word)
        alike = sorted(names, key=lambda one: abs(len(one) - len(word)) + sum(map(operator.ne, one, word)))
        names = sorted({*names[max(0, at - 16) : at + 16], *alike[:32]})
    close = difflib.get_close_matches(word, names, n=1)
    return f"did you mean '{close[0]}'?" if close else ""


class UsageError(SrprovError):
    """Options or arguments that make no sense together."""

    exit_code = 5


class Location(msgspec.Struct, frozen=True, order=True):
    """A place in a user's file; line and column count from 1."""

    file: str
    line: int = 1
    column: int = 1

    def __str__(self) -> str:
        """Return `file:line:column`, as compilers do and editors understand."""
        return f"{self.file}:{self.line}:{self.column}"


class _Coded(msgspec.Struct, frozen=True, order=True, kw_only=True):
    code: Code


class Diagnostic(_Coded, frozen=True, order=True):
    """One thing that is wrong in a user's file; `code` says of which kind, and is given by its name."""

    location: Location
    message: str
    path: str = ""
    """Where inside the document, e.g. `services.talker.cost`."""
    excerpt: str = ""
    """The source line as it stands in the file, for the caret line."""
    hint: str = ""
    """What to do, e.g. `did you mean 'image'?`."""


class DefinitionError(SrprovError):
    """User files that are wrong; carries every problem at once."""

    exit_code = 5

    def __init__(self, problems: Sequence[Diagnostic]) -> None:
        """Take at least one problem; they are sorted by file and line."""
        self.problems = tuple(sorted(problems))
        count, files = len(self.problems), len({one.location.file for one in self.problems})
        message = f"{count} problem{'s' if count != 1 else ''} in {files} file{'s' if files != 1 else ''}"
        super().__init__(message, code=self.problems[0].code if self.problems else Code.BUG)


class RenderError(SrprovError):
    """A playbook that does not render to resources."""

    exit_code = 5


class RefusedError(SrprovError):
    """Something that policy, or the user at the prompt, does not allow."""

    exit_code = 9


class NoAssignment(SrprovError):
    """No placement exists. `misses` maps service -> robot -> what it lacks."""

    exit_code = 8

    def __init__(
        self, message: str, *, code: Code, misses: Mapping[str, Mapping[str, str]] | None = None, hint: str = ""
    ) -> None:
        """Take the explanation in words and the reasons as data."""
        super().__init__(message, code=code, hint=hint)
        self.misses = {s: dict(r) for s, r in (misses or {}).items()}


class LockHeld(SrprovError):
    """Another controller holds the robot."""

    exit_code = 7

    def __init__(self, message: str, *, code: Code = Code.LOCKED, hint: str = "") -> None:
        """Take what the root of the tree takes."""
        super().__init__(message, code=code, hint=hint)


class StalePlan(SrprovError):
    """A robot moved since the plan was made."""

    exit_code = 6

    def __init__(self, message: str, *, code: Code = Code.STALE_PLAN, hint: str = "") -> None:
        """Take what the root of the tree takes."""
        super().__init__(message, code=code, hint=hint)


class PlanError(SrprovError):
    """A cycle among resources, or two resources with one id."""

    exit_code = 5


class TransportError(SrprovError):
    """One robot that cannot be talked to."""

    exit_code = 4

    def __init__(self, host: str, message: str, *, code: Code, hint: str = "") -> None:
        """Take the robot's name first; the message, which does not repeat it, becomes one line."""
        super().__init__(one_line(message), code=code, hint=hint)
        self.host = host


class ConnectError(TransportError):
    """Name lookup, TCP, banner or key exchange failed."""

    def __init__(self, host: str, message: str, *, code: Code = Code.CONNECT, hint: str = "") -> None:
        """Take what every error of one robot takes."""
        super().__init__(host, message, code=code, hint=hint)


class HostKeyError(TransportError):
    """The robot's host key is unknown, or not the one that is on record."""

    def __init__(self, host: str, message: str, *, code: Code = Code.HOST_KEY, hint: str = "") -> None:
        """Take what every error of one robot takes."""
        super().__init__(host, message, code=code, hint=hint)


class AuthError(TransportError):
    """No key or password was accepted, or sudo asks for one."""

    def __init__(self, host: str, message: str, *, code: Code = Code.LOGIN, hint: str = "") -> None:
        """Take what every error of one robot takes."""
        super().__init__(host, message, code=code, hint=hint)


class DeadlineError(TransportError):
    """An answer did not come in time; the message names what was awaited."""

    def __init__(self, host: str, message: str, *, code: Code = Code.DEADLINE, hint: str = "") -> None:
        """Take what every error of one robot takes."""
        super().__init__(host, message, code=code, hint=hint)


class LabError(SrprovError):
    """The embedded lab cannot do what was asked."""

    exit_code = 3
