"""An engine that follows links while it removes folders gets empty ones to remove."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from srprov.execution.emptied import emptied, is_led
from srprov.modules.container_commands import remove
from srprov.session import no_progress
from srprov.wire import EngineCall, EngineQuery, Query, Reply, Run

STOPPED = {"Running": False, "Dead": False}
A, B = "a" * 64, "b" * 64


class Engine:
    """A session whose engine keeps all that it has below a folder; `having` lists the containers that have a volume."""

    def __init__(self, folder: Path, go: str = "go1.19.8", **body: Any) -> None:
        self.folder, self.go, self.body = folder, go, body
        self.having: dict[str, list[str]] = {}
        self.done: list[EngineCall | Run] = []
        self.says = Reply(status=0, ok=True)
        self.silent = ""
        """What `docker` answers with a complaint alone."""
        self.complaint = "permission denied while trying to connect"
        self.after: Callable[[object], None] = lambda _query: None

    def ask(self, queries: list[EngineQuery | Query]) -> list[Reply]:
        return [self._answer(one) for one in queries]

    def _answer(self, query: EngineQuery | Query) -> Reply:
        if isinstance(query, EngineQuery):
            assert query.path == "/version"
            return Reply(status=200, out=json.dumps({"Version": "20.10.24", "GoVersion": self.go}))
        if query.command.startswith("ids=$(docker ps -aq --no-trunc "):  # those that have ended, too
            if self.silent == "ps":
                self.after(query)
                return Reply(status=1, ok=False, err=self.complaint)
            _, _, name = query.command.partition(" --filter volume=")
            return Reply(status=0, out="".join(self.having.get(name.split(")")[0], [])))
        what, *_, last = shlex.split(query.command)[1:]
        if what == self.silent:
            return Reply(status=1, ok=False, err=self.complaint)
        if what == "volume":
            place = str(self.folder / last / "_data")
            return Reply(status=0, out=json.dumps({"Driver": "local", "Mountpoint": place, **self.body}))
        assert (what, last) == ("container", "srprov.x.a")
        return Reply(status=0, out=json.dumps({"Id": "i", "State": STOPPED, **self.body}))

    def execute(self, command: EngineCall | Run, *_: object) -> Reply:
        self.done.append(command)
        if isinstance(command, EngineCall) or not self.says.ok:
            return self.says
        done = subprocess.run(["sh", "-c", command.script], capture_output=True, text=True, check=False)
        return Reply(status=done.returncode, ok=done.returncode == 0, out=done.stdout, err=done.stderr)


def removed(engine: Engine, call: EngineCall | None = None) -> Reply | None:
    return emptied(call or remove("srprov.x.a"), engine, no_progress)  # type: ignore[arg-type]


def volume(name: str) -> EngineCall:
    return EngineCall(method="DELETE", path=f"/volumes/{name}")


def filled(folder: Path) -> Path:
    """Make a folder that is held, with files, a link, and odd names."""
    (folder / "-rf" / "below it").mkdir(parents=True)
    (folder / ".hidden").write_text("x")
    (folder / "out").symlink_to(folder.parent.parent)
    return folder


@pytest.mark.parametrize(
    ("version", "led"),
    [
        ("go1.19.8", True), ("go1.21.10", True), ("go1.21.11", False), ("go1.22", True), ("go1.22rc1", True),
        ("go1.22.3", True), ("go1.22.4", False), ("go1.22.4 X:boringcrypto", False), ("go1.23", False),
        ("go1.23rc1", False), ("go1.25.1", False), ("go1.9", True), ("devel +3a", True), ("", True),
    ],
)  # fmt: skip
def test_engines_are_led_by_what_they_were_built_with(version: str, led: bool) -> None:
    assert is_led(version) is led


def test_what_a_volume_had_is_gone_before_and_nobody_holds_what_is_left(tmp_path: Path) -> None:
    data = filled(tmp_path / "v" / "_data")
    filled(tmp_path / "v" / "_data.old")  # of a run that was killed
    (tmp_path / "w").mkdir()
    held = os.open(data, os.O_PATH)
    assert removed(Engine(tmp_path), volume("v")) is None
    with pytest.raises(FileNotFoundError):
        os.symlink("/usr/local/sbin", "d00", dir_fd=held)
    os.close(held)
    assert os.listdir(tmp_path / "v") == ["_data"] and os.listdir(data) == []
    assert sorted(os.listdir(tmp_path)) == ["v", "w"]


def test_what_a_killed_run_left_goes_also_where_nothing_else_is_left(tmp_path: Path) -> None:
    filled(tmp_path / "v" / "_data.old")
    assert removed(Engine(tmp_path), volume("v")) is None
    assert os.listdir(tmp_path / "v") == []


def test_an_engine_whose_files_are_not_seen_removes_nothing(tmp_path: Path) -> None:
    """Its data lies in a mount namespace of its own: it would go through what this shell does not see."""
    told = removed(Engine(tmp_path / "elsewhere"), volume("v"))
    assert told is not None and not told.ok and "lie where the robot has no such folder" in told.err
    (tmp_path / "elsewhere").mkdir()
    assert removed(Engine(tmp_path / "elsewhere"), volume("v")) is None, "half removed before"


def test_a_volume_that_somebody_has_is_not_removed(tmp_path: Path) -> None:
    """An engine may have another list of who has it than the one that it shows."""
    filled(tmp_path / "v" / "_data")
    engine = Engine(tmp_path)
    engine.having["v"] = ["i /srprov.x.b has has\n"]
    told = removed(engine, volume("v"))
    assert told is not None and not told.ok and told.err == "it is in use by srprov.x.b" and engine.done == []


def test_a_place_of_that_name_is_no_volume(tmp_path: Path) -> None:
    """An image may say `VOLUME srprov.x.v`, and an engine's filter finds a container of it for that volume."""
    data = filled(tmp_path / "v" / "_data")
    engine = Engine(tmp_path)
    engine.having["v"] = ["j /srprov.x.decoy\n"]
    assert removed(engine, volume("v")) is None and list(data.iterdir()) == []


@pytest.mark.parametrize("engine", [{"go": "go1.24.1"}, {"Driver": "nfs"}])
def test_what_needs_nothing_is_left_to_its_engine(tmp_path: Path, engine: dict[str, Any]) -> None:
    filled(tmp_path / "v" / "_data")
    session = Engine(tmp_path, **engine)
    assert removed(session, volume("v")) is None and session.done == []


@pytest.mark.parametrize(
    "body",
    [
        {"Driver": None},
        {"Driver": ""},
        {"Mountpoint": "v/_data"},
        {"Mountpoint": "/v\0/_data"},
        {"Mountpoint": None},
        {"Driver": ["local"]},
    ],
)
def test_a_volume_of_which_too_little_is_told_is_not_removed(tmp_path: Path, body: dict[str, Any]) -> None:
    told = removed(Engine(tmp_path, **body), volume("v"))
    assert told is not None and not told.ok and "does not say where its files lie" in told.err


def test_a_volume_is_not_removed_where_nobody_says_who_has_it(tmp_path: Path) -> None:
    """To empty it would take the data of who has it."""
    filled(tmp_path / "v" / "_data")
    for silent, says in (("volume", "permission denied"), ("ps", "does not say who has its volumes")):
        engine = Engine(tmp_path)
        engine.silent = silent
        told = removed(engine, volume("v"))
        assert told is not None and not told.ok and says in told.err
        assert engine.done == [] and len(list((tmp_path / "v" / "_data").iterdir())) == 3


def test_what_is_gone_is_left_to_its_engine_to_say(tmp_path: Path) -> None:
    engine = Engine(tmp_path)
    engine.silent, engine.complaint = "container", "Error: No such container: srprov.x.a"
    assert removed(engine) is None and engine.done == []


def container(tmp_path: Path, **more: Any) -> Engine:
    """Give an engine whose container has a named volume, and two with no name, one of which another one has."""
    upper = filled(tmp_path / "layer" / "diff")
    mounts = [
        {"Type": "volume", "Name": name, "Driver": "local", "Source": str(filled(tmp_path / name / "_data"))}
        for name in ("named", A, B, "c" * 64, "d" * 64)
    ]
    host = {"Mounts": [{"Source": "named", "Target": "/n"}, {"Source": "c" * 64}], "Binds": [f"{'d' * 64}:/d:ro"]}
    body = {
        "GraphDriver": {"Name": "overlay2", "Data": {"UpperDir": str(upper)}},
        "Mounts": [{"Type": "bind", "Source": "/srv"}, *mounts],
        "HostConfig": host,
    }
    engine = Engine(tmp_path, **{**body, **more})
    engine.having = {A: ["i /a has\n", "k /decoy\n"], B: ["i /a has\n", "j /b has\n"]}
    return engine


def test_a_container_loses_its_own_files_and_its_volumes_with_no_name(tmp_path: Path) -> None:
    engine = container(tmp_path)
    assert removed(engine) is None
    assert [type(one) for one in engine.done] == [Run]
    left = {one: os.listdir(tmp_path / one) for one in os.listdir(tmp_path)}
    assert left == {"layer": ["diff"], **{name: ["_data"] for name in ("named", A, B, "c" * 64, "d" * 64)}}
    empty = {one for one in left if not list((tmp_path / one / left[one][0]).iterdir())}
    assert empty == {"layer", A}


def test_one_that_runs_is_ended_first_and_nothing_is_taken_from_it_else(tmp_path: Path) -> None:
    engine = container(tmp_path, State={"Running": True})
    assert removed(engine) is None
    assert [getattr(one, "path", "") for one in engine.done] == ["/containers/srprov.x.a/stop", ""]
    assert list((tmp_path / "layer" / "diff").iterdir()) == []
    lasting = container(tmp_path / "again", State={"Running": True})
    lasting.says = Reply(status=500, ok=False, err="tried to kill it")
    assert removed(lasting) == lasting.says and len(list((tmp_path / "again/layer/diff").iterdir())) == 3


def test_a_container_whose_files_lie_elsewhere_is_its_engines(tmp_path: Path) -> None:
    engine = container(tmp_path, GraphDriver={"Name": "btrfs", "Data": None}, Mounts=None)
    assert removed(engine) is None and engine.done == []


def test_of_one_that_is_dead_what_has_no_name_is_left(tmp_path: Path) -> None:
    engine = container(tmp_path, GraphDriver={"Name": "", "Data": None}, State={"Running": False, "Dead": True})
    assert removed(engine) is None
    assert list((tmp_path / A / "_data").iterdir()) == [] and len(list((tmp_path / "layer/diff").iterdir())) == 3


@pytest.mark.parametrize(
    "body",
    [
        {"GraphDriver": {"Name": ""}},
        {"GraphDriver": None},
        {"GraphDriver": {"Name": "overlay2", "Data": None}},
        {"State": None},
        {"State": {"Running": "no"}},
        {"State": {"Running": False, "Dead": True}, "GraphDriver": None},
    ],
)
def test_a_container_of_which_too_little_is_told_is_not_removed(tmp_path: Path, body: dict[str, Any]) -> None:
    """Its own command was so long that nothing of it could be read, and its engine was led as before."""
    engine = container(tmp_path, **body)
    told = removed(engine)
    assert told is not None and not told.ok and "does not say where its files lie" in told.err
    assert engine.done == []
    silent = container(tmp_path / "again")
    silent.silent = "ps"
    told = removed(silent)
    assert told is not None and not told.ok and "who has its volumes" in told.err and silent.done == []


def test_what_cannot_be_emptied_is_told_and_not_removed(tmp_path: Path) -> None:
    engine = container(tmp_path)
    engine.says = Reply(status=1, ok=False, err="rm: cannot remove './diff.old/q': Directory not empty\n")
    told = removed(engine)
    assert told is not None and not told.ok
    assert "its files cannot be removed: rm: cannot remove './diff.old/q': Directory not empty\na container" in told.err
    engine.says = Reply(status=47, ok=False, err="")
    assert "cannot be closed off" in str(removed(engine))


def test_an_engine_that_is_away_is_waited_for_as_in_any_other_command(tmp_path: Path) -> None:
    engine, away = container(tmp_path), Reply(status=0, ok=False, err="the Docker Engine closed the connection")
    engine._answer = lambda query: away  # type: ignore[method-assign]
    assert removed(engine) == away and engine.done == []


def test_other_commands_are_not_looked_at(tmp_path: Path) -> None:
    engine = Engine(tmp_path, go="")
    for method, path in (
        ("DELETE", "/networks/x"),
        ("DELETE", "/images/a/b"),
        ("POST", "/containers/x/start"),
        ("POST", "/build"),
    ):
        assert removed(engine, EngineCall(method=method, path=path)) is None
    assert engine.done == []


@pytest.mark.parametrize("where", [".", "below"])
def test_a_volume_with_a_disk_in_it_stays_as_it_is(tmp_path: Path, where: str) -> None:
    """Its folder had been renamed by then, and another one was in its place."""
    folder = tmp_path / "v" / "_data"
    (folder / "below").mkdir(parents=True)
    disk = (folder / where).resolve()
    subprocess.run(["mount", "-t", "tmpfs", "test", disk], check=True)
    try:
        (disk / "mine").write_text("data")
        engine = Engine(tmp_path)
        told = removed(engine, volume("v"))
        assert (disk / "mine").read_text() == "data" and os.listdir(tmp_path / "v") == ["_data"]
    finally:
        subprocess.run(["umount", disk], check=True)
    assert told is not None and not told.ok and "mounted" in told.err and "a container that still runs" not in told.err
    assert not [one for one in engine.done if isinstance(one, EngineCall)]


def test_who_has_a_volume_is_asked_again_where_one_went_meanwhile(tmp_path: Path) -> None:
    filled(tmp_path / "v" / "_data")
    engine = Engine(tmp_path)
    engine.silent, engine.complaint = "ps", "Error: No such container: 0123"
    told = removed(engine, volume("v"))
    assert told is not None and "does not say who has its volumes" in told.err

    def heard(_query: object) -> None:
        engine.silent = ""

    engine.after = heard
    assert removed(engine, volume("v")) is None
