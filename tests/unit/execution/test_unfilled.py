"""A volume is filled from an image for the first container that may write there alone."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from srprov.execution.unfilled import unfilled
from srprov.wire import Command, EngineCall, EngineQuery, Reply, Run


class Engine:
    """A session whose engine lists these containers; its volumes lie in `folder`, where there is one."""

    def __init__(self, answer: object, folder: Path | None = None) -> None:
        self.answer, self.folder, self.asked = answer, folder, list[EngineQuery]()

    def ask(self, queries: list[EngineQuery]) -> list[Reply]:
        self.asked += queries
        return [self._answer(one) for one in queries]

    def _answer(self, query: EngineQuery) -> Reply:
        if query.path.startswith("/volumes/"):
            place = self.folder and self.folder / query.path.removeprefix("/volumes/") / "_data"
            if place is None or not place.exists():
                return Reply(status=404, ok=False, out="{}", err="no such volume")
            return Reply(status=200, ok=True, out=json.dumps({"Mountpoint": str(place)}), err="")
        ok = self.answer is not None
        return Reply(status=200 if ok else 0, ok=ok, out=json.dumps(self.answer), err="" if ok else "away")

    def execute(self, command: Run) -> Reply:
        done = subprocess.run(["sh", "-c", command.script], capture_output=True, text=True, check=False)
        return Reply(status=done.returncode, ok=done.returncode == 0, out=done.stdout, err=done.stderr)


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
        ([having("v", RW=False)], [True, False]),
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
    lists = [dict(one.params) for one in engine.asked if one.path == "/containers/json"]
    assert [json.loads(one["filters"]) for one in lists] == [{"volume": ["v"]}, {"volume": ["w"]}]
    assert all(one["all"] == "true" for one in lists), "one that has ended may start again"


def test_what_is_filled_has_a_folder_of_which_nobody_holds_anything(tmp_path: Path) -> None:
    """A container hands on the open folder of its volume, and is gone: no engine knows who leads it by links then."""
    for name in "vw":
        (tmp_path / name / "_data").mkdir(parents=True, mode=0o750)
    (tmp_path / "w" / "_data" / "mine").write_text("kept")
    held = os.open(tmp_path / "v" / "_data", os.O_PATH)
    assert made(Engine([], tmp_path), V, W) == [False, True]
    with pytest.raises(FileNotFoundError):
        os.symlink("/usr/local/sbin", "d00", dir_fd=held)
    os.close(held)
    new = tmp_path / "v" / "_data"
    assert os.listdir(new) == [] and new.stat().st_mode & 0o7777 == 0o750
    assert os.listdir(new.parent) == ["_data"] and os.listdir(tmp_path / "w") == ["_data"]
    assert (tmp_path / "w" / "_data" / "mine").read_text() == "kept"


def test_a_folder_that_cannot_be_made_anew_is_told(tmp_path: Path) -> None:
    (tmp_path / "v" / "_data").mkdir(parents=True)
    (tmp_path / "v" / "_data.new").write_text("in the way")
    body = json.dumps({"Image": "x", "HostConfig": {"Mounts": [V]}})
    command = EngineCall(method="POST", path="/containers/create", body=body)
    told = unfilled(command, Engine([], tmp_path))  # type: ignore[arg-type]
    assert isinstance(told, Reply) and not told.ok and "File exists" in told.err


def test_a_volume_whose_place_is_not_told_is_not_filled() -> None:
    engine = Engine([])
    engine._answer = lambda query: Reply(status=200, ok=True, out="[]", err="")  # type: ignore[method-assign]
    assert made(engine, V) == [True]


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
