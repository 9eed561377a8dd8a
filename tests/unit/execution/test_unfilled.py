"""A volume is filled from an image in another place, while no container has it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from srprov.errors import TransportError
from srprov.execution.sending import sent
from srprov.execution.unfilled import unfilled
from srprov.modules.container_leftover import left_by_build
from srprov.wire import Command, EngineCall, EngineQuery, Query, Reply, Run


class Engine:
    """A session whose engine lists these containers; its volumes lie in `folder`, where there is one.

    Images have a file for each volume, also in a folder.
    """

    def __init__(self, answer: object, folder: Path | None = None) -> None:
        self.answer, self.folder, self.asked = answer, folder, list[EngineQuery]()
        self.called: list[EngineCall] = []
        self.says: dict[str, Reply] = {}
        """Path of a call -> what is answered in place of doing it."""
        self.volume = {"Driver": "local", "Options": None}
        self.host = "robot1"

    def ask(self, queries: list[EngineQuery | Query]) -> list[Reply]:
        return [self._shell(one.command) if isinstance(one, Query) else self._answer(one) for one in queries]

    def _answer(self, query: EngineQuery) -> Reply:
        self.asked.append(query)
        if query.path.startswith("/volumes/"):
            place = self.folder and self.folder / query.path.removeprefix("/volumes/") / "_data"
            if place is None or not place.exists():
                return Reply(status=404, ok=False, out="{}", err="no such volume")
            return Reply(status=200, ok=True, out=json.dumps({"Mountpoint": str(place), **self.volume}), err="")
        ok = self.answer is not None
        return Reply(status=200 if ok else 0, ok=ok, out=json.dumps(self.answer), err="" if ok else "away")

    def execute(self, command: Run | EngineCall) -> Reply:
        if isinstance(command, Run):
            return self._shell(command.script)
        self.called.append(command)
        if said := self.says.get(command.path):
            return said
        if self.folder and command.path == "/volumes/create":
            (self.folder / json.loads(command.body)["Name"] / "_data").mkdir(parents=True)
        elif self.folder and command.path == "/containers/create":
            for one in json.loads(command.body)["HostConfig"]["Mounts"]:
                (self.folder / one["Source"] / "_data" / "deep").mkdir(mode=0o750)
                (self.folder / one["Source"] / "_data" / "deep" / "image").write_text(one["Target"])
        elif self.folder and command.path.startswith("/volumes/"):
            shutil.rmtree(self.folder / command.path.removeprefix("/volumes/"))
        return Reply(status=201)

    @staticmethod
    def _shell(script: str) -> Reply:
        done = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=False)
        return Reply(status=done.returncode, ok=done.returncode == 0, out=done.stdout, err=done.stderr)


def having(name: str, **more: object) -> dict[str, Any]:
    return {"Mounts": [{"Type": "bind", "Source": "/x"}, {"Type": "volume", "Name": name, "RW": True, **more}]}


CREATE = "/containers/create"


def asked_for(*mounts: dict[str, Any]) -> EngineCall:
    labels = {"srprov.instance": "x", "srprov.source": "s", "own": "1"}
    body = json.dumps({"Image": "x:1", "Cmd": ["run"], "Labels": labels, "HostConfig": {"Mounts": list(mounts)}})
    return EngineCall(
        method="POST", path=CREATE, params=(("name", "srprov.x.a"), ("platform", "linux/arm64")), body=body
    )


def made(engine: Engine, *mounts: dict[str, Any]) -> list[bool]:
    """Return which mounts of a container are told not to be filled."""
    command = unfilled(asked_for(*mounts), engine)  # type: ignore[arg-type]
    assert isinstance(command, EngineCall), command
    return [
        one.get("VolumeOptions", {}).get("NoCopy", False) for one in json.loads(command.body)["HostConfig"]["Mounts"]
    ]


def volumes(folder: Path, **files: str) -> None:
    """Make volumes with a file each, or none."""
    for name, text in files.items():
        (folder / name / "_data").mkdir(parents=True)
        if text:
            (folder / name / "_data" / "mine").write_text(text)


V, W = ({"Type": "volume", "Source": name, "Target": f"/{name}"} for name in "vw")


def test_what_is_empty_is_filled_by_a_container_that_never_runs_and_put_in_its_place(tmp_path: Path) -> None:
    """Not by the service's: its engine went on after Ctrl-C, and the next service led it to the robot's files."""
    volumes(tmp_path, v="", w="kept")
    held = os.open(tmp_path / "v" / "_data", os.O_PATH)
    engine = Engine([], tmp_path)
    assert made(engine, V, W) == [True, True]
    assert (tmp_path / "v/_data/deep/image").read_text() == "/v" and sorted(os.listdir(tmp_path)) == ["v", "w"]
    assert os.listdir(tmp_path / "w/_data") == ["mine"] and os.listdir(tmp_path / "v") == ["_data"]
    with pytest.raises(FileNotFoundError):  # a container handed on the open folder of its volume, and is gone
        os.symlink("/usr/local/sbin", "d00", dir_fd=held)
    os.close(held)
    volume, filler, *removals = engine.called
    (fresh,) = [one["Source"] for one in json.loads(filler.body)["HostConfig"]["Mounts"]]
    assert json.loads(volume.body) == {"Name": fresh, "Labels": {"srprov.instance": "x", "srprov.source": "s"}}
    params, body = dict(filler.params), json.loads(filler.body)
    assert (params["platform"], body["Image"], body["HostConfig"]["NetworkMode"]) == ("linux/arm64", "x:1", "none")
    assert body["HostConfig"]["Mounts"] == [{"Type": "volume", "Source": fresh, "Target": "/v"}]
    assert [(one.method, one.path) for one in removals] == [
        ("DELETE", f"/containers/{params['name']}"), ("DELETE", f"/volumes/{fresh}"),
    ]  # fmt: skip
    item = {"Names": [f"/{params['name']}"], "Image": "x:1"}
    assert left_by_build(item, {"state": "created"}, ()) is not None, "the next run removes what a killed one left"


def test_an_engine_that_is_late_fills_what_no_service_has(tmp_path: Path) -> None:
    """It may go on for hours, so what it fills stays until a later run."""
    volumes(tmp_path, v="")
    engine = Engine([], tmp_path)
    engine.says[CREATE] = Reply(status=0, ok=False, err="the Docker Engine did not answer within 900 s")
    assert unfilled(asked_for(V), engine) == engine.says[CREATE]  # type: ignore[arg-type]
    assert [one.path for one in engine.called] == ["/volumes/create", CREATE], "and the service's is not made"
    assert os.listdir(tmp_path / "v/_data") == [] and len(os.listdir(tmp_path)) == 2


@pytest.mark.parametrize("path", [CREATE, "/volumes/create"])
def test_what_an_engine_refuses_is_told_and_nothing_is_left(tmp_path: Path, path: str) -> None:
    volumes(tmp_path, v="")
    engine = Engine([], tmp_path)
    engine.says[path] = Reply(status=404, ok=False, err="No such image: x:1")
    assert unfilled(asked_for(V), engine) == engine.says[path]  # type: ignore[arg-type]
    assert sorted(os.listdir(tmp_path)) == ["v"] and os.listdir(tmp_path / "v/_data") == []


def test_what_somebody_put_there_meanwhile_stays(tmp_path: Path) -> None:
    volumes(tmp_path, v="")
    engine = Engine([], tmp_path)
    answer = engine._answer

    def meanwhile(query: EngineQuery) -> Reply:
        if query.path.startswith("/volumes/srprov-copy."):
            (tmp_path / "v/_data/theirs").write_text("x")
        return answer(query)

    engine._answer = meanwhile  # type: ignore[method-assign]
    assert made(engine, V) == [True]
    assert os.listdir(tmp_path / "v/_data") == ["theirs"] and os.listdir(tmp_path) == ["v"]


@pytest.mark.parametrize(
    ("listed", "filled"),
    [
        ([], True),
        ([having("v")], False),
        ([having("v", RW=False)], False),
        ([having("v", RW="no")], False),
        ([having("x"), having("/v")], True),
        ([{"Mounts": None}, {}, 3], True),
        ({"message": "no"}, False),
    ],
)
def test_what_others_may_write_to_is_not_filled(tmp_path: Path, listed: object, filled: bool) -> None:
    """A container that ran with the volume put links there while the engine filled it, as root of the robot."""
    volumes(tmp_path, v="")
    engine = Engine(listed, tmp_path)
    assert made(engine, V) == [True]
    lists = [dict(one.params) for one in engine.asked if one.path == "/containers/json"]
    assert [json.loads(one["filters"]) for one in lists] == [{"volume": ["v"]}]
    assert all(one["all"] == "true" for one in lists), "one that has ended may start again"
    assert bool(os.listdir(tmp_path / "v/_data")) is filled is bool(engine.called)


def test_a_volume_that_is_not_there_is_made_first(tmp_path: Path) -> None:
    assert made(Engine([], tmp_path), V) == [True]
    assert (tmp_path / "v/_data/deep/image").read_text() == "/v" and os.listdir(tmp_path) == ["v"]


@pytest.mark.parametrize(
    "volume",
    [
        {"Driver": "nfs"},
        {"Options": {"device": "10.0.0.1:/x"}},
        {"Mountpoint": "v"},
        {"Mountpoint": None},
        {"Mountpoint": "/x\0y"},
    ],
)
def test_a_volume_that_has_no_folder_of_its_own_is_not_filled(tmp_path: Path, volume: dict[str, Any]) -> None:
    volumes(tmp_path, v="")
    engine = Engine([], tmp_path)
    engine.volume |= volume
    assert made(engine, V) == [True] and engine.called == []


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
    assert engine.asked == [] and engine.called == []


def test_a_name_that_a_shell_does_not_see_is_something(tmp_path: Path) -> None:
    """A volume with one file, called by a line feed, counted as empty: no container with it could be made any more."""
    volumes(tmp_path, v="", w="")
    (tmp_path / "v" / "_data" / "\n").write_text("mine")
    engine = Engine([], tmp_path)
    assert made(engine, V, W) == [True, True]
    assert os.listdir(tmp_path / "v" / "_data") == ["\n"] and os.listdir(tmp_path / "w" / "_data") == ["deep"]


def test_a_disk_that_is_mounted_at_a_volumes_place_is_not_filled(tmp_path: Path) -> None:
    volumes(tmp_path, v="")
    subprocess.run(["mount", "-t", "tmpfs", "test", tmp_path / "v" / "_data"], check=True)
    try:
        assert made(Engine([], tmp_path), V) == [True]
        assert os.listdir(tmp_path / "v" / "_data") == []
    finally:
        subprocess.run(["umount", tmp_path / "v" / "_data"], check=True)


def test_what_a_robot_says_that_cannot_be_a_command_is_that_robots_failure() -> None:
    """A traceback ended the run of all robots."""
    engine = Engine(None)
    engine.ask = mock.Mock(  # type: ignore[method-assign] - a lie
        side_effect=ValueError("a shell word cannot hold a NUL byte")
    )
    with pytest.raises(TransportError, match="its answers cannot be read: ValueError: a shell word") as told:
        sent(asked_for(V), engine)  # type: ignore[arg-type]
    assert told.value.host == "robot1"
