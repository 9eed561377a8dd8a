"""Every file of `tests/cases/command/` is one test: a wanted command and the exit code of its check.

As in test_cases.py, with `probe`, the raw replies to what is asked for this one command (null: it was never asked), and
`asks`, the questions. Commands are the one kind that does not show by looking around.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from srprov.modules import MODULES, PROBING
from srprov.wire import Query, Reply
from tests.resources import resource
from tests.unit.modules.test_cases import merged

CASES = Path(__file__).parents[2] / "cases" / "command"
KEYS = {"says", "want", "probe", "asks", "found", "change", "commands"}


@pytest.mark.parametrize("path", sorted(CASES.glob("*.yml")), ids=lambda path: path.stem)
def test_case(path: Path) -> None:
    """What is wanted and what its check said give the change and the command of the case."""
    case = yaml.safe_load(path.read_text())
    assert set(case) <= KEYS
    want = merged(yaml.safe_load((CASES / "defaults.yaml").read_text())["want"], case.get("want", {}))
    name, params = want["name"], resource("command", want["name"], want["params"]).params
    module, probing = MODULES["command"], PROBING["command"]
    asks = probing.probes(name, params)
    if "asks" in case:
        assert [query.command for query in asks] == case["asks"]
    assert all(isinstance(query, Query) for query in asks)
    replies = [Reply(status=0, out=out) for out in case["probe"] or ()]
    found = probing.probed(name, params, replies) if replies else None
    if "found" in case:
        assert found is not None
        assert [f"{found.instance} {found.name}".strip()] == case["found"]
    change = module.check(name, params, found.state if found else None)
    shown = {"action": change.action.name.lower(), "cause": change.cause} if change else None
    assert shown == case["change"]
    if "commands" in case:
        assert change is not None
        assert [command.text() for command in change.commands] == case["commands"]


def test_nothing_of_a_command_is_listed_or_removed() -> None:
    """Nobody can see what a command did: it asks nothing of its own and takes nothing away."""
    module = MODULES["command"]
    params = resource("command", "x", {"argv": ["a"], "creates": "/b"}).params
    assert module.queries() == () == module.parse(())
    assert module.removal(PROBING["command"].probed("x", params, [Reply(status=0, out="0")])) == ()
