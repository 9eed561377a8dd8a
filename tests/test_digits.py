"""Digits are told by `isdecimal`: `isdigit` also says yes to `²`, of which `int` makes an error that nobody expects.

What is read of robots, registries and files may hold any character. Everything is read with `ast`.
"""

from __future__ import annotations

import ast

from tests.test_rooms import sources

NO_NUMBER = ("importing/compose/",)
"""Rooms that only look at a character, as Compose does, and make no number of it."""


def told(path: str, source: str) -> list[str]:
    """List, as `file:line`, where digits are told in another way."""
    if path.startswith(NO_NUMBER):
        return []
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Attribute))
    return [f"srprov/{path}:{node.lineno}: {node.attr}" for node in calls if node.attr in ("isdigit", "isnumeric")]


def test_what_is_told_to_be_digits_is_a_number() -> None:
    found = [line for path, source in sources().items() for line in told(path, source)]
    assert not found, "\n".join(found)


def test_the_checker_sees_both() -> None:
    assert len(told("x.py", "a.isdigit() or b[0].isnumeric()")) == 2 and not told("x.py", "a.isdecimal()")
