"""Hints are there to be copied into a shell: what is put into a command there is one word of it, whatever its name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

SOURCES = sorted((Path(__file__).resolve().parents[2] / "srprov").rglob("*.py"))
COMMAND = re.compile(
    r"(^|[`:] ?)(srprov [a-z]+|chmod|chown|mkdir|rm|mv|cp|git|ssh-keygen|ssh-keyscan|docker) [^`]*$"
    r"|(^|[ `])(--[a-z-]+|-[a-z]) (\./)?$|: @$"
)
"""What a shell would run, or what is added to that, up to a place where something is put in."""
WHOLE_PATH = re.compile(r"\b(realpath|abspath|absolute|resolve)\(")
"""What gives a path from the root, wherever it stands in a hint: it is there to be named in a command."""
OBEYS = re.compile(r"ansible-inventory|ansible-playbook|docker (compose )?cp|kubectl cp|pip install '?srprov")
"""Programs that do what files of the folder, or of a container, say; and a package that anybody could register."""
CLOSED = {
    "os.geteuid()": "a number",
    "name": "of an image, and checked: see `images.hint`",
    "off[name].profiles[0]": "checked by the schema",
    "endpoint.service": "a service's name",
}
"""What needs no quotes, and why."""


def hints(tree: ast.AST) -> Iterator[ast.JoinedStr]:
    """Yield each text with places that is called a hint."""
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "hint":
            found: ast.AST = node.value
        elif isinstance(node, ast.Assign) and any(ast.unparse(one).endswith("hint") for one in node.targets):
            found = node.value
        elif isinstance(node, ast.FunctionDef) and "hint" in node.name:
            found = node
        else:
            continue
        yield from (one for one in ast.walk(found) if isinstance(one, ast.JoinedStr))


def unquoted(source: str) -> Iterator[str]:
    """Yield each place in a command that may be more than one word."""
    for text in hints(ast.parse(source)):
        so_far = ""
        for part in text.values:
            if isinstance(part, ast.Constant):
                so_far += str(part.value)
                continue
            assert isinstance(part, ast.FormattedValue)
            put = ast.unparse(part.value)
            is_word = COMMAND.search(so_far) or WHOLE_PATH.search(put)
            if is_word and put not in CLOSED and "quote(" not in put:
                yield f"{so_far}{{{put}}}"
            so_far += "x"


def test_what_is_put_into_a_command_is_quoted() -> None:
    """A project's file may be called `$(curl ...).cdf`."""
    found = {str(path): list(unquoted(path.read_text(encoding="utf-8"))) for path in SOURCES}
    assert found and {path: some for path, some in found.items() if some} == {}


def test_a_place_without_quotes_is_seen() -> None:
    assert list(unquoted('raise E("x", hint=f"see `srprov validate {path}`, or leave it")')) == [
        "see `srprov validate {path}"
    ]
    assert list(unquoted('raise E("x", hint=f"name its whole path: --facts {path}")')) == [
        "name its whole path: --facts {path}"
    ]
    assert list(unquoted('raise E("x", hint=f"then: chmod go-w {quote(path)}")')) == []
    assert list(unquoted('raise E("x", hint=f"name that: {option}{os.path.realpath(path)}")')) == [
        "name that: x{os.path.realpath(path)}"
    ]
    assert list(unquoted('raise E("x", hint=f"name that: {option}{quote(os.path.realpath(path))}")')) == []


def test_no_hint_runs_a_program_on_what_a_stranger_wrote() -> None:
    """`ansible-inventory` in a project's folder runs what its `ansible.cfg` names, as the user."""
    pages = sorted((Path(__file__).resolve().parents[2] / "srprov" / "explaining").glob("*.yml"))
    assert len(pages) > 3
    found = [str(path) for path in (*SOURCES, *pages) if OBEYS.search(path.read_text(encoding="utf-8"))]
    assert found == []
