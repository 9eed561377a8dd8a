"""A volume is filled from an image for the first container that may write there alone."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.execution.unfilled import unfilled
from srprov.wire import Command, EngineCall, EngineQuery, Reply, Run


class Engine:
    """A session whose engine lists these containers."""

    def __init__(self, answer: object) -> None:
        self.answer, self.asked = answer, list[EngineQuery]()

    def ask(self, queries: list[EngineQuery]) -> list[Reply]:
        self.asked += queries
        ok = self.answer is not None
        return [Reply(status=0, ok=ok, out=json.dumps(self.answer), err="" if ok else "away") for _ in queries]


def having(name: str, **more: object) -> dict[str, Any]:
    return {"Mounts": [{"Type": "bind", "Source": "/x"}, {"Type": "volume", "Name": name, "RW": True, **more}]}


def made(engine: Engine, *mounts: dict[str, Any]) -> list[bool]:
    """Return which mounts of a container are told not to be filled."""
    body = json.dumps({"Image": "x", "HostConfig": {"Mounts": list(mounts)}})
    command = unfilled(EngineCall(method="POST", path="/containers/create", body=body), engine)  # type: ignore[arg-type]
    assert isinstance(command, EngineCall)
    return [
        one.get("VolumeOptions", {}).get("NoCopy", False) for one in json.loads(command.body)["HostConfig"]["Mounts"]
    ]


V, W = ({"Type": "volume", "Source": name, "Target": f"/{name}"} for name in "vw")


@pytest.mark.parametrize(
    ("listed", "kept"),
    [
        ([], [False, False]),
        ([having("v")], [True, False]),
        ([having("v", RW=False)], [False, False]),
        ([having("v", RW=False), having("v")], [True, False]),
        ([having("v", RW="no")], [True, False]),
        ([having("x"), having("/v")], [False, False]),
        ([{"Mounts": None}, {}, 3], [False, False]),
        ({"message": "no"}, [True, True]),
        (None, [True, True]),
    ],
)
def test_what_others_may_write_to_is_not_filled(listed: object, kept: list[bool]) -> None:
    """A container that ran with the volume put links there while the engine filled it, as root of the robot."""
    engine = Engine(listed)
    assert made(engine, V, W) == kept
    assert [json.loads(dict(one.params)["filters"]) for one in engine.asked] == [{"volume": ["v"]}, {"volume": ["w"]}]
    assert all(dict(one.params)["all"] == "true" for one in engine.asked), "one that has ended may start again"


def test_nothing_is_asked_where_nothing_would_be_filled() -> None:
    engine = Engine([having("v")])
    alone = {**V, "ReadOnly": True, "VolumeOptions": {"NoCopy": True}}
    assert made(engine, alone, {"Type": "volume", "Target": "/a"}, {"Type": "bind", "Source": "/v"}) == [
        True,
        False,
        False,
    ]
    for command in (Run(script="x"), EngineCall(method="POST", path="/containers/v/start")):
        kept: Command = command
        assert unfilled(kept, engine) is kept  # type: ignore[arg-type]
    assert engine.asked == []
