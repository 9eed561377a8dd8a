"""What Jinja2 says of a playbook's template, and the names in it that there are not.

Takes its text; gives problems. The template is parsed and never compiled or rendered. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from srprov.codes import Code
from srprov.definitions import template
from srprov.definitions.template import HOLE, MARK
from srprov.errors import did_you_mean
from srprov.yamldoc.nodes import Findings, Scalar, Source

if TYPE_CHECKING:
    from jinja2 import Environment
    from jinja2.nodes import Node

VARIABLES = (
    "api", "data", "files", "folder", "host", "images", "instance", "log_driver", "overlay", "robot", "secrets",
    "services", "source", "trees", "volumes",
)  # fmt: skip
"""What a playbook is rendered with; docs/playbooks.md says what each holds."""

_DEEPEST = 150
"""Levels of a template: a folder's path or a sum has some ten, and each takes several frames of Python's stack."""


def check_template(text: str, source: Source, findings: Findings) -> bool:
    """Add what Jinja2 refuses, unknown blocks and unknown names; return whether the rest can be checked."""
    from jinja2 import TemplateSyntaxError
    from jinja2.sandbox import ImmutableSandboxedEnvironment

    for number, line in enumerate(source.lines, 1):
        if (column := min((line.find(one) for one in (HOLE, MARK) if one in line), default=-1)) >= 0:
            place = Scalar(source, number, column + 1, "")
            findings.add(place, "holds a character that srprov keeps for itself", code=Code.TEMPLATE)
    for part in template.pieces(text):
        if part.kind == "block" and part.word not in template.BLOCKS:
            place = scalar_at(text, part.start, source)
            hint = f"known: {', '.join(template.BLOCKS)}"
            findings.add(place, f"a playbook knows no block '{part.word[:40]}'", (), hint, code=Code.TEMPLATE)
    if findings.problems:
        return False
    env = ImmutableSandboxedEnvironment()
    try:
        # parsed, never compiled: the compiler computes constants, and `9**9**9` would keep it busy for ever
        tree = env.parse(text)
    except TemplateSyntaxError as error:
        findings.add(Scalar(source, error.lineno, 1, ""), f"is no Jinja2 template: {error.message}", code=Code.TEMPLATE)
        return False
    except ValueError:
        findings.add(Scalar(source, 1, 1, ""), "is no Jinja2 template: a number is too long", code=Code.TEMPLATE)
        return False
    except RecursionError:
        tree = None
    if tree is None or not _is_flat(tree):
        findings.add(Scalar(source, 1, 1, ""), "its expressions are nested too deeply", code=Code.TEMPLATE)
        return False
    _check_names(tree, env, source, findings)
    return True


def _check_names(tree: Node, env: Environment, source: Source, findings: Findings) -> None:
    """Add the variables, filters and tests that there are not."""
    from jinja2 import nodes as syntax

    names = list(tree.find_all(syntax.Name))
    known = {*VARIABLES, *env.globals, *(one.name for one in names if one.ctx == "store"), "loop"}
    used: list[tuple[str, Any, Collection[str]]] = []
    used += [("variable", one, VARIABLES) for one in names if one.name not in known]
    used += [("filter", one, env.filters) for one in tree.find_all(syntax.Filter)]
    used += [("test", one, env.tests) for one in tree.find_all(syntax.Test)]
    # what a name may mean is looked for once, however often it stands in a line
    wrong = {(what, one.lineno, one.name): choices for what, one, choices in used if one.name not in choices}
    for (what, row, name), choices in wrong.items():
        match = re.search(rf"\b{re.escape(name)}\b", source.excerpt(row))
        hint = did_you_mean(name, choices) or (f"known: {', '.join(VARIABLES)}" if what == "variable" else "")
        place, told = Scalar(source, row, match.start() + 1 if match else 1, ""), f"there is no {what} '{name[:60]}'"
        findings.add(place, told, (), hint, code=Code.TEMPLATE)


def _is_flat(tree: Node) -> bool:
    """Return whether no level is too deep for what goes through it; `a/a/a/…` is read in a loop, and nested too."""
    level: list[Node] = [tree]
    for _ in range(_DEEPEST):
        level = [child for one in level for child in one.iter_child_nodes()]
        if not level:
            return True
    return False


def scalar_at(text: str, offset: int, source: Source) -> Scalar:
    """Return a character's place in a text."""
    line_start = text.rfind("\n", 0, offset) + 1
    return Scalar(source, text.count("\n", 0, offset) + 1, offset - line_start + 1, "")
