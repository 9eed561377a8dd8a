"""Every file of `tests/cases/<kind>/` is one test: what is wanted and what a robot said give a change and its commands.

A case holds

    says:      the behaviour as a sentence
    want:      {name, params} of a resource; laid over the `want` of the folder's defaults.yaml, null takes a key away
    replies:   raw answers to the module's queries, in order: text, or a value that is sent as JSON, or {status, out}
    change:    {action, cause} of the check, or null when it is right
    commands:  what makes it right, as a plan shows it
    found:     `instance name` of everything of ours in the replies
    removal:   commands that take the wanted name away

defaults.yaml holds `want`, and `replies` by name. The first of these, as many as the module has queries and in their
order, are what a robot answers that has the wanted one: test_garbage.py breaks them.

and only what it is about: what is left out is not looked at. A reply may be `$name` from the defaults' `replies`.
Adding a behaviour is adding a file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from srprov.modules import MODULES
from srprov.wire import Reply
from tests.resources import resource

CASES = Path(__file__).parents[2] / "cases"
ELSEWHERE = {
    "command": "test_command.py: it is probed, so it has cases of its own form",
    "secret": "test_secret_module.py: no file may hold its value",
    "wireguard_peers": "test_wireguard_peers.py: what is wanted follows from what other robots say",
}
"""Kinds whose tests have another form -> where, and why."""
KINDS = tuple(kind for kind in MODULES if kind not in ELSEWHERE)
FILES = sorted(path for kind in KINDS for path in (CASES / kind).glob("*.yml"))
KEYS = {"says", "want", "replies", "change", "commands", "found", "removal"}


def merged(base: Any, over: Any) -> Any:
    """Lay one mapping over another, deep; null takes a key away."""
    if not isinstance(base, dict) or not isinstance(over, dict):
        return over
    both = {**base, **{key: merged(base.get(key), value) for key, value in over.items()}}
    return {key: value for key, value in both.items() if not (key in over and over[key] is None)}


def reply(raw: Any, known: dict[str, Any]) -> Reply:
    """Return one reply of a robot; `joined` lists are one."""
    if isinstance(raw, dict) and set(raw) == {"joined"}:
        parts = [known[part[1:]] if isinstance(part, str) else part for part in raw["joined"]]
        raw = [item for part in parts for item in part]
    if isinstance(raw, str) and raw.startswith("$"):
        raw = known[raw[1:]]
    if isinstance(raw, dict) and set(raw) <= {"status", "out"}:
        status = raw["status"]
        return Reply(status=status, out=raw.get("out", ""), ok=status == 0 or 200 <= status < 300)
    return Reply(status=200, out=raw if isinstance(raw, str) else json.dumps(raw))


def blobs_of(written: dict[str, Any]) -> dict[str, bytes]:
    """Return the blobs that a case names: each by its own text."""
    return {written["blob"]: written["blob"].encode()} if "blob" in written else {}


@pytest.mark.parametrize("path", FILES, ids=[f"{path.parent.name}/{path.stem}" for path in FILES])
def test_case(path: Path) -> None:
    """What is wanted and what a robot said give the change and the commands of the case."""
    defaults = yaml.safe_load((path.parent / "defaults.yaml").read_text())
    case = yaml.safe_load(path.read_text())
    assert set(case) <= KEYS and {"says", "replies"} <= set(case) and len(case) > 2
    module = MODULES[path.parent.name]
    want = merged(defaults["want"], case.get("want", {}))
    written, name = want["params"], want["name"]
    wanted = resource(module.kind, name, written, blobs=blobs_of(written))
    replies = [reply(raw, defaults.get("replies", {})) for raw in case["replies"]]
    assert len(replies) == len(module.queries())
    found = module.parse(replies)
    mine = next((one for one in found if one.name == name), None)
    if "found" in case:
        assert [f"{one.instance} {one.name}".strip() for one in found] == case["found"]
    if "change" in case or "commands" in case:
        change = module.check(name, wanted.params, mine.state if mine else None)
        shown = {"action": change.action.name.lower(), "cause": change.cause} if change else None
        assert shown == case["change"]
        if change is not None:
            assert [command.text() for command in change.commands] == case["commands"]
    if "removal" in case:
        assert mine is not None
        assert [command.text() for command in module.removal(mine)] == case["removal"]


def test_every_kind_has_its_cases() -> None:
    """A kind without cases would be a kind without a contract."""
    counts = {kind: sum(path.parent.name == kind for path in FILES) for kind in KINDS}
    assert min(counts.values()) >= 4, counts
