"""Every error has a code, by the call that makes it; the codes are those that were given once.

Everything is read with `ast`. A kind of error whose class says all has the code of its class.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from srprov.codes import Code
from tests.test_rooms import sources

GOLDEN = Path(__file__).parent / "golden" / "codes.txt"

WIDE = frozenset(
    {"SrprovError", "UsageError", "RenderError", "RefusedError", "NoAssignment", "PlanError", "TransportError"}
    | {"LabError", "Diagnostic"}
)
"""Classes whose calls say which kind of error it is."""
GATHERED = frozenset({"findings", "own", "unsupported", "found"})
"""Names of what gathers problems, by its method `add`."""


def without_code(path: str, source: str) -> Iterator[str]:
    """List, as `file:line: what`, the calls that make an error and say no code; `path` is as below `srprov/`."""
    for node in ast.walk(ast.parse(source, filename=path)):
        if isinstance(node, ast.Call) and _makes_error(node) and not any(one.arg == "code" for one in node.keywords):
            yield f"srprov/{path}:{node.lineno}: {ast.unparse(node.func)} without code=Code.…, see srprov/codes.py"


def _makes_error(call: ast.Call) -> bool:
    if isinstance(call.func, ast.Name):
        return call.func.id in WIDE
    if not isinstance(call.func, ast.Attribute):
        return False
    owner = ast.unparse(call.func.value).rpartition(".")[2]
    return (owner, call.func.attr) == ("nodes", "problem") or (
        call.func.attr == "add" and owner in GATHERED and len(call.args) > 1
    )


def test_every_error_has_a_code() -> None:
    found = [line for path, source in sources().items() for line in without_code(path, source)]
    assert not found, "\n".join(found)


def test_the_check_sees_a_call_without_a_code() -> None:
    bad = 'raise UsageError("no", hint="x")\nfindings.add(node, "no")\nself.findings.add(node, "no", code=Code.NAME)\n'
    assert [line.split(":")[1] for line in without_code("a.py", bad)] == ["1", "2"]


def test_codes_are_those_that_were_given_once() -> None:
    """A new one is added to the list by hand; one that is on it never goes, and never means something else."""
    given = [line.split() for line in GOLDEN.read_text().splitlines()]
    assert [[one.value, one.name] for one in Code] == given
    assert len({value for value, _ in given}) == len(given)
    assert all(re.fullmatch(r"SRP-[0-9]{3}", value) for value, _ in given)
    assert given == sorted(given)


def test_every_code_is_said_somewhere() -> None:
    """One that no error has would be a page that nobody is sent to."""
    text = "\n".join(source for path, source in sources().items() if path != "codes.py")
    unused = [one.name for one in Code if not re.search(rf"\bCode\.{one.name}\b", text)]
    assert not unused
