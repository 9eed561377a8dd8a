"""Words of a Dockerfile: each kind of value in the one form in which nothing of it can become an instruction.

Takes a user's text; gives Dockerfile text of one physical line. Pure. A Dockerfile has three readers (its line
parser, its variable expansion and the shell), so every kind of field has its own function, and a line break is
refused wherever it cannot be written.
Source: Dockerfile reference; deb-version(7), PEP 508, PEP 440, npm's package names.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Sequence

LONGEST_LINE = 65_000
"""Bytes; the classic builder refuses lines of 65535."""

_LONGEST_PACKAGE = 200
"""Characters, with the version."""
_APT = re.compile(
    r"[a-z0-9][a-z0-9+.-]*[a-z0-9+](:[a-z0-9][a-z0-9-]*)?(=[A-Za-z0-9][A-Za-z0-9.+:~*-]*|/[A-Za-z0-9][A-Za-z0-9.-]*)?"
)
_BOUND = r"(===|==|~=|!=|<=|>=|<|>)[A-Za-z0-9][A-Za-z0-9.*+!_-]*"
_PIP = re.compile(
    rf"[A-Za-z0-9]([A-Za-z0-9._-]*[A-Za-z0-9])?(\[[A-Za-z0-9._-]+(,[A-Za-z0-9._-]+)*\])?({_BOUND}(,{_BOUND})*)?"
)
_NPM = re.compile(r"(@[a-z0-9][a-z0-9._-]*/)?[a-z0-9][a-z0-9._-]*(@[A-Za-z0-9^~<>=*][A-Za-z0-9.^~<>=*+_-]*)?")
_PACKAGES = {"apt": (_APT, "curl=7.88.*"), "pip": (_PIP, "numpy==1.26.4"), "npm": (_NPM, "ws@8.18.0")}


def package(kind: str, name: str) -> str:
    """Return one package of `apt`, `pip` or `npm`, with its version if it has one; blanks around operators go.

    Raises:
        ValueError: A character that no package name or version has, or an option in disguise.
    """
    pattern, example = _PACKAGES[kind]
    if len(name) > _LONGEST_PACKAGE:
        raise ValueError(f"'{name[:60]}' is longer than {_LONGEST_PACKAGE} characters, which no package's name is")
    plain = re.sub(r" *([=<>!~,]+) *", r"\1", name.strip(" "))
    if not pattern.fullmatch(plain):
        raise ValueError(f"'{name}' is no {kind} package as srprov takes them (such as '{example}')")
    return plain


def one_line(what: str, value: str) -> str:
    """Return the value when it has no control character.

    Raises:
        ValueError: It has one: a line break, say, cannot be written into a Dockerfile.
    """
    if any(unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") for c in value):
        raise ValueError(f"{what} has a line break or another control character, which an image cannot keep")
    return value


def variable(name: str, value: str) -> str:
    """Return `NAME="value"` for ENV and LABEL, with nothing expanded.

    Raises:
        ValueError: The name is none, or the value has control characters.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", name):
        raise ValueError(f"'{name}' is no name of a variable")
    escaped = re.sub(r'(["$\\])', r"\\\1", one_line(name, value))
    return f'{name}="{escaped}"'


def path(what: str, value: str) -> str:
    """Return a path for WORKDIR or, inside JSON, COPY: what expansion would take for quotes or variables is escaped.

    Raises:
        ValueError: It is empty or has control characters.
    """
    if not value or value != value.strip():
        raise ValueError(f"{what} is empty, or begins or ends with a blank")
    return re.sub(r"([\"'$\\])", r"\\\1", one_line(what, value))


def exec_form(words: Sequence[str]) -> str:
    """Return the JSON form of RUN, COPY, CMD or ENTRYPOINT: one line whatever the words hold, and no shell reads it."""
    return json.dumps(list(words))


def user(value: str) -> str:
    """Return the argument of USER.

    Raises:
        ValueError: It is no `name`, `uid`, `name:group` or `uid:gid`.
    """
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*(:[A-Za-z0-9_][A-Za-z0-9_.-]*)?", value):
        raise ValueError(f"'{value}' is no user of an image")
    return value


def signal(value: str) -> str:
    """Return the argument of STOPSIGNAL.

    Raises:
        ValueError: It is no signal's name or number.
    """
    if not re.fullmatch(r"[0-9]{1,2}|(SIG)?[A-Z][A-Z0-9]{1,8}([+-][0-9]{1,2})?", value):
        raise ValueError(f"'{value}' is no signal")
    return value
