"""docs/walk.md is the way that the code takes: each hop is a call, and none goes upward."""

from __future__ import annotations

import ast
import functools
import re

import pytest

from tests.pages import ROOT
from tests.test_rooms import FILES, PACKAGE, ROOMS, allows, room_of

PAGE = (ROOT / "docs" / "walk.md").read_text(encoding="utf-8")
HOPS = [(one[1], one[2]) for one in re.finditer(r"^\| \d+ \| `([^`]+)` \| `([^`]+)` \|", PAGE, re.MULTILINE)]
PASSED_IN = {
    "cli/apply.py:apply": "main",  # by click, which finds the verb by its name
    "controller/run.py:run.recorded": "listener",
    "cli/progress.py:_Shown.listen": "listener",
    "transport/pool.py:Sessions.get": "readers",
    "transport/session.py:BaseSession.ask": "ask",
    "transport/session.py:BaseSession.execute": "execute",
    "transport/session.py:BaseSession.open_lock_channel": "open_lock_channel",
}
"""What the caller's room may not import, but was given -> its name there."""
KNOWN_AS = PASSED_IN | {
    "definitions/__init__.py:load_inventory": "load",
    "transport/engine/adapter.py:EngineAdapter.send": "request",  # of the docker SDK, which goes through requests
    "modules/container_params.py:ContainerParams.__post_init__": "kind",  # its class is a parameter
}
"""What has another name where it is called -> that name."""


@functools.cache
def tree(path: str) -> ast.AST:
    """Return a file of the package."""
    return ast.parse((PACKAGE / path).read_text(encoding="utf-8"))


def function(place: str) -> ast.AST:
    """Return the function of `file:Class.name`."""
    path, _, dotted = place.partition(":")
    found: ast.AST = tree(path)
    for name in dotted.split("."):
        inner = [node for node in ast.walk(found) if getattr(node, "name", "") == name and node is not found]
        assert inner, f"there is no {place}"
        found = inner[0]
    return found


def test_the_page_counts_its_hops_and_rooms() -> None:
    rooms = {room_of(place.partition(":")[0]) for _, place in HOPS}
    assert f"{len(HOPS)} hops through\n{len(rooms)} rooms" in PAGE
    numbers = [int(one) for one in re.findall(r"^\| (\d+) \| `", PAGE, re.MULTILINE)]
    assert numbers == list(range(1, len(HOPS) + 1))


@pytest.mark.parametrize(("caller", "callee"), HOPS)
def test_a_hop_is_a_call_that_the_rooms_allow(caller: str, callee: str) -> None:
    """Its name is in the caller; what its room may not import was passed in."""
    function(callee)
    *_, last = callee.removesuffix(".__init__").replace(":", ".").split(".")
    name = KNOWN_AS.get(callee, last)
    used = {getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(function(caller))}
    assert name in used, f"{caller} does not call {name}"
    path, target = caller.partition(":")[0], callee.partition(":")[0]
    mine, theirs = room_of(path), room_of(target)
    module = target.removesuffix(".py").replace("/", ".").removesuffix("__init__")
    allowed = FILES.get(path, ROOMS[mine]).ours
    fine = mine == theirs or allows(allowed, f"{module.rstrip('.')}.{last}")
    assert fine or callee in PASSED_IN, f"{mine} may not import {target}"
