"""The folder of a collect: one srprov at a time, what stays of robots that are away, and clear ends."""

from __future__ import annotations

import datetime as dt
import errno
import json
import os
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.cli import inputs
from srprov.cli.collect import collect
from srprov.controller import collected as collected_module
from srprov.controller import collection
from srprov.controller.collected import check_folder
from srprov.controller.trial_folder import alone, check_new, check_own, make_folder
from srprov.definitions.model import Definitions, Experiment
from srprov.errors import RefusedError, UsageError
from srprov.execution.trial_patience import EquipmentFailed
from srprov.record.results import open_part
from tests.fakes import World
from tests.worlds import apply, experiment, fleet, service

PAIR = experiment(service("near", robot="r1"), service("far", robot="r2"))


def test_a_second_srprov_in_a_folder_is_refused_until_the_first_has_ended(tmp_path: Path) -> None:
    with alone(tmp_path), pytest.raises(UsageError, match="another srprov works in"), alone(tmp_path):
        raise AssertionError("both work in it")
    with alone(tmp_path):
        assert not list(tmp_path.iterdir())


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_given: Any, **_more: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "home/logs/robot1.web.log")

    monkeypatch.setattr(collection, "collect", full)
    monkeypatch.setattr(inputs, "load_inventory", lambda _paths: None)
    monkeypatch.setattr(inputs, "load_experiment", lambda _path: Definitions(experiment=PAIR, containers={}))
    monkeypatch.setattr(inputs, "named_instance", lambda *_given: ("hand", "hand.edf"))
    monkeypatch.setattr(inputs, "connect", lambda *_given: nullcontext())
    given = {"file": "hand.edf", "inventories": (), "as_json": False, "forks": 1, "timeout": 1.0, "instance": ""}
    run: Any = collect.callback
    with pytest.raises(UsageError, match=r"home/logs/robot1\.web\.log: No space left on device") as refused:
        run(**given, target=tmp_path / "home")
    assert refused.value.exit_code == 5 and "collect again" in refused.value.hint


def pair() -> World:
    """Return two robots with a service each."""
    world = World().add("r1", "r2")
    assert apply(world, PAIR).exit_code == 0
    return world


def collected(world: World, folder: Path, what: Experiment = PAIR) -> Any:
    """Collect, and return what is written."""
    told = collection.collect(fleet(world), what, "hello", folder, lambda _said: None, source=f"lab@desk:{PAIR.file}")
    files = {name: json.loads((folder / f"{name}.json").read_text()) for name in ("collected", "containers", "facts")}
    assert files["collected"] == told
    return SimpleNamespace(**files)


def test_an_edf_brings_nothing_of_what_another_one_of_its_name_made(tmp_path: Path) -> None:
    """A stranger's may be called as the user's own one, name what comes, and ship the folder with the next apply."""
    world, said = pair(), list[str]()
    with pytest.raises(RefusedError, match=r"was made from lab@desk:.*, not from x$") as refused:
        collection.collect(fleet(world), PAIR, "hello", tmp_path / "home", said.append, source="x")
    assert (refused.value.exit_code, "--instance hello" in refused.value.hint) == (9, True)
    assert not (tmp_path / "home").exists() and not said
    collection.collect(fleet(world), PAIR, "hello", tmp_path / "home", said.append, source="x", meant=True)
    assert (tmp_path / "home" / "collected.json").exists()
    assert [one for one in said if one.startswith("note: instance 'hello' on")], "whoever named it himself is told"


def lost(host: str) -> Callable[..., Any]:
    """Return a `bring_log` in which a robot is lost."""

    def bring_log(robot: Any, *_given: Any) -> None:
        if robot.host == host:
            raise EquipmentFailed(f"{host}: it is away")

    return bring_log


def clock(monkeypatch: pytest.MonkeyPatch, minute: int) -> str:
    now = dt.datetime(2026, 1, 2, 3, minute, tzinfo=dt.timezone.utc)
    monkeypatch.setattr(
        collected_module, "dt", SimpleNamespace(datetime=SimpleNamespace(now=lambda _zone: now), timezone=dt.timezone)
    )
    return now.isoformat(timespec="seconds")


@pytest.mark.parametrize("how", ["unreachable", "lost meanwhile"])
def test_what_is_here_of_a_robot_that_is_away_stays_and_says_of_when_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    world, folder = pair(), tmp_path / "home"
    first = clock(monkeypatch, 1)
    before = collected(world, folder)
    assert before.collected["brought_utc"] == {"r1": first, "r2": first}
    for container in world.robots["r2"].engine.containers.values():
        container.state = "exited"
    if how == "unreachable":
        world.robots["r2"].gone = True
    else:
        monkeypatch.setattr(collection, "bring_log", lost("r2"))
    second = clock(monkeypatch, 2)
    after = collected(world, folder)
    assert set(after.collected["unreachable"]) == {"r2"}
    assert after.containers["far"] == before.containers["far"] is not None
    assert after.facts["robots"]["r2"] == before.facts["robots"]["r2"]
    assert after.collected["brought_utc"] == {"r1": second, "r2": first}
    assert after.collected["robots"] == {"near": "r1", "far": "r2"}


def test_what_cannot_be_written_of_one_robot_is_named_and_the_others_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "home").mkdir(mode=0o700)
    (tmp_path / "home" / "collected.json").write_text('{"instance": "hello"}')
    (tmp_path / "home" / "logs" / "r1.near.log.part").mkdir(parents=True)
    after = collected(pair(), tmp_path / "home")
    (line,) = after.collected["failed"]
    assert line.startswith("near: ") and "r1.near.log.part: Is a directory" in line
    assert (tmp_path / "home" / "logs" / "r2.far.log").is_file() and not after.collected["unreachable"]
    assert set(after.containers) == {"near", "far"}


BROKEN = {
    "collected.json": ["", "{", "[]", "5", '{"instance": 5}', '{"robots": {}}', '{"instance": "hello", "results": []}',
                       '{"instance": "hello", "results": {"a": [3]}}', '{"instance": "hello", "robots": {"a": {}}}',
                       '{"instance": "hello", "brought_utc": {"a": 3}}', "[" * 100_000],
    "containers.json": ["{", "[]"],
    "facts.json": ["{", "[]"],
}  # fmt: skip


@pytest.mark.parametrize(("name", "text"), [(name, text) for name, some in BROKEN.items() for text in some])
def test_a_broken_document_is_named_with_what_to_do_and_nothing_is_lost(tmp_path: Path, name: str, text: str) -> None:
    world, folder = pair(), tmp_path / "home"
    collected(world, folder)
    (folder / name).write_text(text)
    files = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for refusing in (lambda: check_folder(folder, "hello"), lambda: collected(world, folder)):
        with pytest.raises(UsageError, match=f"{name} is broken: ") as refused:
            refusing()
        assert "nothing was changed" in refused.value.hint and "or name another folder" in refused.value.hint
    assert files == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    if name == "collected.json":
        assert 'write {"instance": "hello"} into it' in refused.value.hint
        (folder / name).write_text('{"instance": "hello"}')
    else:
        assert "move it away" in refused.value.hint
        (folder / name).unlink()
    check_folder(folder, "hello")
    assert set(collected(world, folder).containers) == {"near", "far"}


@pytest.mark.parametrize(
    "place", ["results/rec/out", "containers.json", "collected.json", "logs", ".parts", "trials.csv", "trials/a-r002"]
)
def test_a_folder_with_a_link_in_it_is_not_gone_on_with(tmp_path: Path, place: str) -> None:
    """Whoever clones a project has a stranger's links in folders of his own."""
    outside, folder = tmp_path / "outside", tmp_path / "data"
    (outside / "authorized_keys").mkdir(parents=True)
    (folder / "trials").mkdir(mode=0o700, parents=True)
    (folder / "collected.json").write_text('{"instance": "hello", "robots": {}, "results": {}}')
    check_folder(folder, "hello")
    check_own(folder)
    link = folder / place
    link.unlink(missing_ok=True)
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(outside)
    with pytest.raises(RefusedError, match=f"{place} is a link, and srprov makes none") as refused:
        check_own(folder)
    assert refused.value.exit_code == 9 and "remove it" in refused.value.hint
    if place != "collected.json":  # without one nothing says that the folder is of a collect
        with pytest.raises(RefusedError, match=f"{place} is a link"):
            check_folder(folder, "hello")


@pytest.mark.parametrize("place", [".parts/near/small", "journal.jsonl", "trials/a-r002/.parts/small"])
def test_a_folder_with_another_name_of_a_file_in_it_is_not_gone_on_with(tmp_path: Path, place: str) -> None:
    """An archive that is unpacked in the user's home makes a hard link to his `.bashrc`, to be written to."""
    shell, folder = tmp_path / ".bashrc", tmp_path / "data"
    shell.write_text("# the user's own\n")
    (folder / "trials").mkdir(mode=0o700, parents=True)
    (folder / "collected.json").write_text('{"instance": "hello"}')
    (folder / place).parent.mkdir(parents=True, exist_ok=True)
    os.link(shell, folder / place)
    with pytest.raises(RefusedError, match=rf"{place} has another name \(a hard link\), and srprov makes none"):
        check_own(folder)
    with pytest.raises(RefusedError, match="has another name") as refused:
        check_folder(folder, "hello")
    assert refused.value.exit_code == 9
    (folder / place).unlink()
    check_folder(folder, "hello")


@pytest.mark.parametrize("place", [".parts/near/small", "journal.jsonl", "trials/a-r002/.parts/small"])
def test_a_folder_with_a_device_or_pipe_in_it_is_not_gone_on_with(tmp_path: Path, place: str) -> None:
    """Root's tar makes what an archive says: a disk of this machine, to be written to."""
    folder = tmp_path / "data"
    (folder / "trials").mkdir(mode=0o700, parents=True)
    (folder / "collected.json").write_text('{"instance": "hello"}')
    (folder / place).parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(folder / place)
    with pytest.raises(RefusedError, match=rf"{place} is a device, pipe or socket, and srprov makes none"):
        check_own(folder)
    with pytest.raises(RefusedError, match="is a device"):
        check_folder(folder, "hello")
    with pytest.raises(OSError, match="a device, pipe or socket is there"):
        open_part(folder / place)


@pytest.mark.parametrize("used", [False, True])
def test_a_folder_that_is_a_link_is_not_used(tmp_path: Path, used: bool) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir(mode=0o700)
    if used:
        (folder / "collected.json").write_text('{"instance": "hello", "robots": {}, "results": {}}')
    (tmp_path / "data").symlink_to(folder)
    with pytest.raises((RefusedError, UsageError), match="is a link"):
        check_folder(tmp_path / "data", "hello")
    check_folder(folder, "hello")


@pytest.mark.parametrize("mode", [0o777, 0o1777])
def test_an_empty_folder_to_which_others_may_write_is_no_new_one(tmp_path: Path, mode: int) -> None:
    """They put a link in the place of what is made there next, and what comes home is written where it leads."""
    check_new(tmp_path)
    tmp_path.chmod(mode)
    with pytest.raises(RefusedError, match="writable by others"):
        check_new(tmp_path)
    with pytest.raises(RefusedError, match="writable by others"):
        check_folder(tmp_path, "hand")
    with pytest.raises(RefusedError, match="writable by others"):
        make_folder(tmp_path)
    (tmp_path / "home").mkdir()
    os.chown(tmp_path / "home", 65534, 65534)
    with pytest.raises(RefusedError, match="somebody else's"):
        check_new(tmp_path / "home")
