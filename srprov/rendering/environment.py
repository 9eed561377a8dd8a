"""The Jinja2 environment of playbooks: sandboxed, StrictUndefined, every substitution a whole JSON value.

Text that is put into YAML by a plain template changes its type ("yes" becomes true) or breaks the document ("a:
b"). Here each `{{ … }}` writes its value as JSON, which is YAML too, so any text arrives as it was. The price is a
rule for authors: a substitution is always a whole YAML value. `name: ros-{{ n }}` would slip through as the text
`ros-"x"`; `check_whole_values` refuses it.
"""

from __future__ import annotations

import json
from typing import Any

from jinja2 import StrictUndefined, Undefined
from jinja2.sandbox import ImmutableSandboxedEnvironment

from srprov.errors import RenderError

_VALUE_OPENERS = ("", ":", "-", "[", ",", "{")
_VALUE_CLOSERS = ("", "]", ",", "}", "#")


def _finalize(value: object) -> str:
    """Write a value as JSON; an undefined one fails with its own message, which JSON would hide."""
    if isinstance(value, Undefined):
        return str(value)
    return json.dumps(value, ensure_ascii=True, sort_keys=True)


def environment() -> ImmutableSandboxedEnvironment:
    """Give a fresh environment; no loader, so a playbook can include nothing."""
    env = ImmutableSandboxedEnvironment(
        undefined=StrictUndefined, finalize=_finalize, trim_blocks=True, lstrip_blocks=True, autoescape=False
    )
    return env


def check_whole_values(env: ImmutableSandboxedEnvironment, text: str, name: str) -> None:
    """Refuse a substitution that is only a part of a YAML value.

    Raises:
        RenderError: Names the playbook and the line.
    """
    before, depth_line = "", 0
    tokens = list(env.lex(text, name=name))
    for index, (line, kind, value) in enumerate(tokens):
        if kind == "data":
            before = value
        elif kind == "variable_begin" and not _opens_value(before):
            _refuse(name, line)
        elif kind == "variable_end":
            depth_line = line
            after = tokens[index + 1] if index + 1 < len(tokens) else (line, "data", "")
            if after[1] == "variable_begin" or (after[1] == "data" and not _closes_value(after[2])):
                _refuse(name, depth_line)
            before = ""


def _opens_value(before: str) -> bool:
    tail = before.rsplit("\n", 1)[-1]
    stripped = tail.strip()
    return stripped == "" or (stripped[-1:] in _VALUE_OPENERS and (tail[-1:] in (" ", "[", "{", ",")))


def _closes_value(after: str) -> bool:
    head = after.split("\n", 1)[0].strip()
    return head[:1] in _VALUE_CLOSERS


def _refuse(name: str, line: int) -> None:
    raise RenderError(
        f"{name}:{line}: a substitution must be a whole YAML value",
        hint='write the parts as one expression, e.g. {{ "ros-" ~ name }}',
    )


Context = dict[str, Any]
