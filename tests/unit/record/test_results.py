"""What robots give is kept under harmless names, up to a size, in time that grows with it alone."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from srprov.controller.bringing import Bringing, Home
from srprov.controller.collected import check_folder
from srprov.definitions.model import VERSION_CONTROL
from srprov.execution.collect import CollectFailed, Place, Robot
from srprov.execution.listing import Entry
from srprov.record import results
from srprov.record.results import LogTooLong, Names, sync, write_log
from tests.bounded import bounded


def named(paths: Iterable[str]) -> list[str]:
    names = Names()
    return [names.name(path.split("/")) for path in paths]


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (".git/config", "%2Egit/config"),
        ("a/.Git/HEAD", "a/%2EGit/%48EAD"),
        (".hg/hgrc", "%2Ehg/hgrc"),
        ("bare/head", "bare/%68ead"),
        ("meshes/head/a.stl", "meshes/head/a.stl"),
        (".github/x", ".github/x"),
        ("HEADER", "HEADER"),
    ],
)
def test_no_result_makes_a_repository_here(path: str, name: str) -> None:
    """Its settings would name programs, which run as soon as git is asked for its status in it."""
    assert Names().name(path.split("/")) == name


@pytest.mark.parametrize("folder", sorted(VERSION_CONTROL))
def test_no_result_makes_a_repository_of_any_kind(folder: str) -> None:
    for name in (folder, folder.lower(), folder.upper()):
        assert Names().name(["out", name, "config"]) == f"out/%{ord(name[0]):02X}{name[1:]}/config"


def test_names_that_differ_only_by_case_are_no_work() -> None:
    paths = ["".join(c.upper() if number >> bit & 1 else c for bit, c in enumerate("abcdefghijklm"))
             for number in range(3000)]  # fmt: skip
    names = bounded(lambda: named(paths))
    assert len({one.casefold() for one in names}) == 3000


def test_a_folder_of_a_files_name_but_for_case_is_another() -> None:
    names = named(["A", "a/x", "a/X", "SS", "\u00df/y", 'abc"'])
    assert names == ["A", "a%2/x", "a%2/X%2", "SS", "\u00df%2/y", "abc%22"]


def test_what_lies_too_deep_is_listed(tmp_path: Path) -> None:
    deep = "a/" * 2000 + "x"
    bringing = Bringing(cast(Robot, None), Place(root="/v", path="."), tmp_path, Home(tmp_path / "parts"))
    listed = [Entry("b", "l", link="c"), Entry(deep, "f", 1, "0" * 64), Entry("c", "p")]
    kept = bounded(lambda: bringing.all(listed))
    assert [one.name for one in kept] == ["", "", ""]
    assert kept[1].path == deep and kept[1].note == "it lies deeper than 100 folders"


def test_a_result_of_too_many_folders_fails_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "MOST_FOLDERS", 1000)
    robot = cast(Robot, SimpleNamespace(host="robot1"))
    bringing = Bringing(robot, Place(root="/v", path="data"), tmp_path, Home(tmp_path / "parts"))
    listed = [Entry(f"{number}/" + "a/" * 9 + "f", "f", 1, "0" * 64) for number in range(101)]
    with pytest.raises(CollectFailed, match="robot1: data: it has more than 1000 folders"):
        bringing.once(listed)
    assert len(named(one.path for one in listed[:100])) == 100
    assert len(set(named(f"d/{number}" for number in range(2000)))) == 2000, "files are no folders"


def test_a_log_has_a_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "MOST_LOG", 5 << 20)
    path = tmp_path / "logs" / "robot1.a.log"
    write_log(iter(["x" * 1023] * 5120), path)
    assert path.stat().st_size == 5 << 20
    with pytest.raises(LogTooLong, match="its log has more than 5 MiB"):
        write_log(iter(["x" * 1023] * 5121), path)


def test_a_log_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    def lost() -> Iterable[str]:
        yield "the first line"
        raise ConnectionError

    path = tmp_path / "a.log"
    write_log(iter(["the old log"]), path)
    with pytest.raises(ConnectionError):
        write_log(iter(lost()), path)
    assert path.read_text() == "the old log\n"


def test_each_file_reaches_the_disk_and_many_are_waited_for_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = [tmp_path / str(number) for number in range(64)]
    for place in places:
        place.write_text("x")
    done = list[str]()

    def fsync(descriptor: int) -> None:
        time.sleep(0.1)
        done.append(os.readlink(f"/proc/self/fd/{descriptor}"))

    monkeypatch.setattr(os, "fsync", fsync)
    began = time.monotonic()
    sync(places)
    assert sorted(done) == sorted(map(str, places)) and time.monotonic() - began < 64 * 0.1 / 2
    places[5].unlink()
    with pytest.raises(FileNotFoundError):
        sync(places)


def test_what_is_gone_at_the_second_listing_is_no_empty_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: object) -> Iterator[bytes]:
        yield b"x"
        raise CollectFailed("r1: it is gone")

    monkeypatch.setattr("srprov.controller.bringing.fetch_file", nothing)
    monkeypatch.setattr("srprov.controller.bringing.listings", lambda *_: [None])
    robot = cast(Robot, SimpleNamespace(host="r1"))
    bringing = Bringing(robot, Place(root="/v", path="data"), tmp_path / "to", Home(parts=tmp_path / "parts"))
    assert bringing.all([Entry("big", "f", 20 << 20, "0" * 64)]) is None, "it is missing, as if it had never been"


def test_an_own_list_of_many_files_or_odd_names_can_be_read_again(tmp_path: Path) -> None:
    name = ":" * 2_000_001
    (tmp_path / "collected.json").write_text(f'{{"instance": "x", "results": {{"a": [{{"path": "{name}"}}]}}}}')
    check_folder(tmp_path, "x")
