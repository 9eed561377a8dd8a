"""The Jinja2 environment of playbooks: sandboxed, StrictUndefined, every substitution a whole JSON value.

Text that is put into YAML by a plain template changes its type ("yes" becomes true) or breaks the document ("a:
b"). Here each `{{ … }}` writes its value as JSON in one tagged scalar, so any value arrives as it was. The price is a
rule for authors: a substitution is always a whole YAML value. `check_whole_values` refuses `name: ros-{{ n }}` and
names the line; what it cannot see, because a block or a line break is in between, `load` refuses.
"""

from __future__ import annotations

import json
from typing import Any

import yaml
from jinja2 import StrictUndefined, Undefined
from jinja2.sandbox import ImmutableSandboxedEnvironment

from srprov.codes import Code
from srprov.errors import RenderError

TAG = "!json"
"""Of a substitution in the rendered text: JSON in one quoted scalar, since not all JSON means the same in YAML 1.1."""
_VALUE_OPENERS = ("", ":", "-", "[", ",", "{")
_VALUE_CLOSERS = ("", "]", ",", "}", "#")


def _finalize(value: object) -> str:
    """Write a value as JSON; an undefined one fails with its own message, which JSON would hide."""
    if isinstance(value, Undefined):
        return str(value)
    text = json.dumps(value, ensure_ascii=True, sort_keys=True, default=_no_json)
    return f"{TAG} {json.dumps(text)}"


def _no_json(value: object) -> str:
    """Refuse what is no JSON; an undefined value inside a list fails with its own message too."""
    if isinstance(value, Undefined):
        return str(value)
    raise TypeError(f"a {type(value).__name__} is no JSON value")


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Safe YAML in which a substitution is a value of its own; one that melted into other text is refused."""

    def construct_scalar(self, node: yaml.ScalarNode) -> Any:  # noqa: ANN401 - as yaml has it
        """Return the text of a scalar that the author wrote."""
        if f'{TAG} "' in str(node.value):
            problem = "a substitution must be a whole YAML value"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return super().construct_scalar(node)


_Loader.add_constructor(TAG, lambda _loader, node: json.loads(node.value))


def load(text: str) -> Any:  # noqa: ANN401 - whatever the playbook says
    """Read what a playbook rendered to.

    Raises:
        yaml.YAMLError, ValueError: It is no YAML; or a substitution is only a part of a value.
    """
    return yaml.load(text, Loader=_Loader)  # noqa: S506 - a safe loader


def environment() -> ImmutableSandboxedEnvironment:
    """Return a fresh environment; no loader, so a playbook can include nothing."""
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
        code=Code.TEMPLATE,
    )
