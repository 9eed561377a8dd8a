"""Every file of `tests/cases/command/` is one test: a wanted command and the exit code of its check.

As in test_cases.py, with `probe`, the raw replies to what is asked for this one command (null: it was never asked), and
`asks`, the questions. Commands are the one kind that does not show by looking around.
"""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from srprov.modules import MODULES, PROBING
from srprov.resource import Resource
from srprov.wire import Query, Reply
from tests.unit.modules.test_cases import merged

CASES = Path(__file__).parents[2] / "cases" / "command"
KEYS = {"says", "want", "probe", "asks", "found", "change", "commands"}


@pytest.mark.parametrize("path", sorted(CASES.glob("*.yml")), ids=lambda path: path.stem)
def test_case(path: Path) -> None:
    """What is wanted and what its check said give the change and the command of the case."""
    case = yaml.safe_load(path.read_text())
    assert set(case) <= KEYS
    want = merged(yaml.safe_load((CASES / "defaults.yaml").read_text())["want"], case.get("want", {}))
    resource = Resource(host="r1", module="command", name=want["name"], params=want["params"])
    module, probing = MODULES["command"], PROBING["command"]
    asks = probing.probes(resource)
    if "asks" in case:
        assert [query.command for query in asks] == case["asks"]
    assert all(isinstance(query, Query) for query in asks)
    replies = [Reply(status=0, out=out) for out in case["probe"] or ()]
    found = probing.probed(resource, replies) if replies else None
    if "found" in case:
        assert found is not None
        assert [f"{found.instance} {found.name}".strip()] == case["found"]
    change = module.check(resource, found.state if found else None)
    shown = {"action": change.action.name.lower(), "cause": change.cause} if change else None
    assert shown == case["change"]
    if "commands" in case:
        assert change is not None
        assert [command.text() for command in module.commands(resource, change)] == case["commands"]


def test_nothing_of_a_command_is_listed_or_removed() -> None:
    """Nobody can see what a command did: it asks nothing of its own and takes nothing away."""
    module = MODULES["command"]
    resource = Resource(host="r1", module="command", name="x", params={"argv": ["a"], "creates": "/b"})
    assert module.queries() == () == module.parse(())
    assert module.removal(PROBING["command"].probed(resource, [Reply(status=0, out="0")])) == ()
