"""Lines of a robot's answer are read by `untrusted.lines_of`, which takes a number: empty ones alone are gigabytes.

Whoever splits an answer in another way adds a line here, with the reason why it cannot be long.
"""

from __future__ import annotations

import ast
import io
import tarfile
from collections.abc import Mapping

import pytest

from srprov.facts.placements import without_records
from srprov.modules import MODULES
from srprov.modules.container_limits import limits_of, of_builds
from srprov.modules.differences import whole_difference
from srprov.modules.tree import content_difference
from srprov.robot_answers import MOST_LINES, TooManyError
from srprov.wire import Reply
from tests.bounded import bounded
from tests.test_rooms import sources

ROOMS = ("modules/", "facts/", "execution/")
SPLIT: Mapping[str, str] = {
    "modules/differences.py:text_difference": "its length was compared with MOST_READ right before",
}
"""`file:function` -> why what it splits cannot be long."""
LONGEST = 16 << 20
"""Bytes of an answer."""


def splits(path: str, source: str) -> list[str]:
    """List, as `file:function`, where all of what a reply has in `out` is split, also when it was stripped first."""
    tree = ast.parse(source, filename=path)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and _is_whole(node.func):
            inside = [one.name for one in functions if one.lineno <= node.lineno <= (one.end_lineno or 0)]
            found.append(f"{path}:{inside[-1] if inside else ''}")
    return found


def _is_whole(method: ast.Attribute) -> bool:
    inner = method.value
    while isinstance(inner, ast.Call) and isinstance(inner.func, ast.Attribute):
        inner = inner.func.value
    return method.attr in ("split", "splitlines") and isinstance(inner, ast.Attribute) and inner.attr == "out"


def test_no_answer_is_split_into_as_many_lines_as_it_has() -> None:
    found = [one for path, source in sources().items() if path.startswith(ROOMS) for one in splits(path, source)]
    assert sorted(found) == sorted(SPLIT)


def test_the_checker_sees_each_way_to_split() -> None:
    ways = ("replies[0].out.split('\\n')", "reply.out.splitlines()", "future.result().out.strip().split()")
    assert [splits("x.py", f"def a():\n  return {way}") for way in ways] == [["x.py:a"]] * len(ways)
    assert splits("x.py", "lines_of(reply.out, 3)\nline.split()\nreply.out.strip()") == []


@pytest.mark.parametrize("kind", ["data", "file", "secret", "tree", "unit"])
@pytest.mark.parametrize("line", ["\n", "a\n"])
def test_an_answer_of_very_many_lines_is_none(kind: str, line: str) -> None:
    reply = Reply(status=0, out=line * (LONGEST // len(line)))
    with pytest.raises(TooManyError, match=f"more than {MOST_LINES} lines"):
        bounded(lambda: MODULES[kind].parse([reply]), 1.0, 64 << 20)


@pytest.mark.parametrize("kind", ["data", "file", "secret", "tree", "unit"])
def test_an_answer_of_as_many_lines_as_are_read_is_one(kind: str) -> None:
    reply = Reply(status=0, out="\n" * (MOST_LINES - 1))
    assert bounded(lambda: MODULES[kind].parse([reply]), 1.0, 64 << 20) == ()


def test_what_is_no_list_of_things_takes_little_memory_either() -> None:
    """Limits of containers are told where they can be read; of a file or folder that is compared, that it cannot be."""
    reply, whole = Reply(status=0, out="\n" * LONGEST), io.BytesIO()
    with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name in ("x/a", "x/b"):
            archive.addfile(tarfile.TarInfo(name))

    def read() -> tuple[object, ...]:
        tree = content_difference("f", "/p", (reply, reply), whole.getvalue())
        kept = len(without_records(reply).out)
        return limits_of(reply), of_builds(reply), tree.note, whole_difference("f", reply, "a\n").diff, kept

    said = bounded(read, 2.0, 64 << 20)
    assert said == ({}, frozenset(), "the old content was not read", ("@@ all of it @@", "+a"), 0)
