"""Results of containers are read by a real shell and GNU tools, from a folder that others may have filled."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import pytest

from srprov import private
from srprov.controller import bringing, results
from srprov.controller.bringing import Bringing, Home, _listed
from srprov.controller.results import bring_results, listed
from srprov.definitions.trialsmodel import Result
from srprov.execution.collect import CollectFailed, Place, fetch_file, fetch_tar, listings, place_of, places_below
from srprov.execution.listing import Entry, Listing, ListingError
from srprov.led import LED
from srprov.pace import Pace
from srprov.record.results import Kept, Names
from srprov.session import Session, Traffic
from srprov.transport.shell.pipes import PipeStreams
from srprov.wire import quote
from tests.bounded import bounded

_T = TypeVar("_T")
ANY = Traffic()


class Machine:
    """A robot whose shells are this machine's; `cuts` are the bytes after which its streams end, one after the other.

    `before` is called with each script, and `lie` says what its listings are instead of what they would be.
    """

    host = "robot1"

    def __init__(self, *cuts: int) -> None:
        self.cuts, self.sent, self.scripts = list(cuts), 0, list[str]()
        self.before: Callable[[str], object] = lambda _script: None
        self.lie: Callable[[bytes], bytes] = lambda said: said
        self.runs = ""

    def do(self, work: Callable[[Session], _T]) -> _T:
        return work(cast(Session, self))

    def open_shell(self, script: str) -> Any:
        self.scripts.append(script)
        self.before(script)
        return Cut(self, self.runs.format(quote(script)) if self.runs else script)


class Cut(PipeStreams):
    """A shell on this machine whose connection may be cut."""

    def __init__(self, machine: Machine, script: str) -> None:
        super().__init__(script, ANY)
        self.machine = machine
        is_content = "sha256sum" not in script
        self.left = machine.cuts.pop(0) if machine.cuts and is_content else None
        self.lies = not is_content
        self.over = False

    def read(self) -> tuple[bytes, bytes]:
        out, err = super().read()
        if self.lies:
            return self.machine.lie(out), err
        if self.left is not None:
            out = out[: self.left]
            self.left -= len(out)
            self.over = self.left == 0
        self.machine.sent += len(out)
        return out, b"" if self.over else err

    @property
    def ended(self) -> bool:
        return self.over or super().ended


def offered(root: Path, path: str = ".") -> list[Entry] | None:
    return listings(Machine(), [Place(root=str(root), path=path)])[0]


def brought(root: Path, home: Path, path: str = ".", machine: Machine | None = None) -> dict[str, Kept]:
    """Bring a folder home; return what became of each entry."""
    machine, place = machine or Machine(), Place(root=str(root), path=path)
    (entries,) = listings(machine, [place])
    assert entries is not None
    kept = Bringing(machine, place, home, Home(parts=home.parent / "parts")).all(entries)
    assert kept is not None
    return {one.path: one for one in kept}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "root"
    folder.mkdir()
    return folder


def test_files_come_home_as_they_are(root: Path, tmp_path: Path) -> None:
    (root / "a").mkdir()
    (root / "a" / "x.bin").write_bytes(b"\0\xff" * 5000)
    (root / "empty").write_bytes(b"")
    os.link(root / "a" / "x.bin", root / "twin")
    found = brought(root, tmp_path / "home")
    assert {path: one.size for path, one in found.items()} == {"a/x.bin": 10_000, "empty": 0, "twin": 10_000}
    assert (tmp_path / "home" / "a" / "x.bin").read_bytes() == (tmp_path / "home" / "twin").read_bytes()
    assert (tmp_path / "home" / "a" / "x.bin").stat().st_mode & 0o777 == 0o600


@pytest.fixture
def disk(root: Path) -> Iterator[Path]:
    """Have the robot mount another disk in the folder, with a file, above one that it hides."""
    folder = root / "sub" / "my disk"
    (folder / "in").mkdir(parents=True)
    (folder / "in" / "hidden").write_bytes(b"old" * 1_000_000)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", folder], check=True)
    try:
        (folder / "in").mkdir()
        (folder / "in" / "run.bag").write_text("data")
        yield folder
    finally:
        subprocess.run(["umount", folder], check=True)


@pytest.mark.parametrize("path", [".", "sub", "sub/my disk", "sub/my disk/in", "sub/my disk/gone"])
def test_what_lies_on_another_disk_of_the_robot_is_not_missing_in_silence(
    root: Path, disk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    """A container sees it. The robot's folder, closed off from all others, shows what the disk hides there."""
    (root / "sub" / "beside").write_text("here")
    monkeypatch.setattr(bringing, "_FEW", 0)  # in a tar
    monkeypatch.setattr(bringing, "_ENTRY", 1024)
    monkeypatch.setattr(bringing, "MOST_FOLDERS", 100)
    found = brought(root, tmp_path / "home", path)
    failed = {one.path: one.note for one in found.values() if one.failed}
    mounted = os.path.relpath(disk, (root / path).parent if path != "." else root)
    assert list(failed) == [mounted if disk.is_relative_to(root / path) else path.rpartition("/")[2]]
    assert "something else is mounted there" in "".join(failed.values())
    came = {one.path for one in found.values() if one.name}
    assert came == {".": {"sub/beside"}, "sub": {"sub/beside"}}.get(path, set())


def test_a_disk_that_the_container_mounts_by_itself_comes_with_it(root: Path, disk: Path, tmp_path: Path) -> None:
    for number in range(30):
        (root / "sub" / f"beside{number}").write_text("here")
    mounts = [
        {"Source": str(root), "Destination": "/data", "RW": True},
        {"Source": str(disk), "Destination": "/data/sub/my disk", "RW": True},
    ]
    home = Home(parts=tmp_path / "parts")
    found, _ = bring_results(Machine(), {"Mounts": mounts}, [Result(path="/data")], tmp_path / "home", home)
    came = {f"sub/beside{number}" for number in range(30)} | {"sub/my disk/in/run.bag"}
    assert {one.path: one.failed for some in found.values() for one in some} == dict.fromkeys(came, False)


def test_a_listing_of_mounts_alone_has_an_end() -> None:
    """Each is compared with each file."""
    every = b"".join(b"M 0 ./m%d\0\0" % number for number in range(300))
    with pytest.raises(ListingError, match="more than 256 mounts"):
        Listing(1).feed(every + b"H\0=0\0")


def test_a_folder_that_cannot_be_read_is_told(root: Path, tmp_path: Path) -> None:
    """Such as one of root's, where another user logs in, or one that a network's disk does not give to root."""
    (root / "closed" / "deep").mkdir(parents=True)
    (root / "closed" / "bag").write_text("data")
    for number in range(9):
        (root / f"closed{number}").mkdir(mode=0)
    (root / "open").write_text("data")
    os.chmod(root / "closed", 0)
    machine = Machine()
    machine.runs = "exec setpriv --bounding-set=-dac_override,-dac_read_search sh -c {}"
    found = brought(root, tmp_path / "home", ".", machine)
    assert {path: one.failed for path, one in found.items()} == {".": True, "open": False}
    assert "cannot be read" in found["."].note


HOSTILE = ["line\nfeed", "x" * 255, "Case", "case", "a\\b", "%41", "CON: <x>", "\x1b[31m", "..\u202e", " ", "-rf"]


def test_names_do_no_harm(root: Path, tmp_path: Path) -> None:
    """Each file is there once, below the folder, under a name that no terminal and no file system takes amiss."""
    for name in HOSTILE:
        (root / name).write_text(name)
    os.makedirs(os.fsencode(root) + b"/not-utf8-\xff")
    Path(os.fsdecode(os.fsencode(root) + b"/not-utf8-\xff/f")).write_text("f")
    found = brought(root, tmp_path / "home")
    assert len(found) == len(HOSTILE) + 1
    names = [one.name for one in found.values()]
    assert len({name.casefold() for name in names}) == len(names)
    for one in found.values():
        assert one.name.isprintable() and len(one.name) <= 220 and ".." not in one.name.split("/")
        assert (tmp_path / "home" / one.name).is_file()
    assert {(tmp_path / "home" / found[name].name).read_text() for name in HOSTILE} == set(HOSTILE)
    assert found["-rf"].name == "-rf" and found["line\nfeed"].note


def test_links_pipes_and_devices_are_listed_and_not_followed(root: Path, tmp_path: Path) -> None:
    decoy = tmp_path / "decoy"
    decoy.write_text("secret")
    (root / "link").symlink_to(decoy)
    (root / "up").symlink_to("..")
    os.mkfifo(root / "pipe")
    found = brought(root, tmp_path / "home")
    assert {path: one.note for path, one in found.items()} == {
        "link": f"a link to {decoy}",
        "up": "a link to ..",
        "pipe": "neither file nor folder nor link",
    }
    assert not (tmp_path / "home").exists()


def test_a_path_that_leads_out_is_refused_and_one_that_is_not_there_is_nothing(root: Path, tmp_path: Path) -> None:
    (tmp_path / "decoy").write_text("secret")
    (root / "out").symlink_to(tmp_path)
    assert offered(root, "no/such") is None
    assert offered(tmp_path / "gone") is None
    with pytest.raises(CollectFailed, match="a link leads out of its folder"):
        offered(root, "out/decoy")
    place = Place(root=str(root), path="out/decoy")
    for pieces in (fetch_file(Machine(), place, 6, 0), fetch_tar(Machine(), place, (), 10_000)):
        with pytest.raises(CollectFailed, match="a link leads out of its folder"):
            list(pieces)


@pytest.mark.skipif(os.geteuid() != 0, reason="devices are root's")
def test_a_device_that_is_put_in_the_place_of_a_file_does_not_come(root: Path) -> None:
    subprocess.run(["mknod", root / "zeros", "c", "1", "5"], check=True)
    place = Place(root=str(root), path="zeros")
    with pytest.raises(CollectFailed, match="Permission denied"):
        list(fetch_file(Machine(), place, 6, 0))
    assert b"\0" * 1024 in (tar := b"".join(fetch_tar(Machine(), place, (), 20_480))) and len(tar) <= 20_480


def test_one_file_or_a_folder_below_comes_alone(root: Path, tmp_path: Path) -> None:
    (root / "deep" / "er").mkdir(parents=True)
    (root / "deep" / "er" / "a").write_text("a")
    (root / "deep" / "b").write_text("b")
    assert set(brought(root, tmp_path / "one", "deep/b")) == {"b"}
    assert set(brought(root, tmp_path / "two", "deep/er")) == {"er/a"}


def test_a_link_that_is_put_in_the_way_meanwhile_is_not_followed(root: Path, tmp_path: Path) -> None:
    """Something swaps a folder with a link to outside all the time: what comes is from inside, or nothing does."""
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "f").write_text("secret")
    (root / "x").mkdir()
    (root / "x" / "f").write_text("harmless")
    swap = f'cd "$0" && while :; do mv x y; ln -s {tmp_path}/outside x; rm x; mv y x; done'
    swapping = subprocess.Popen(["sh", "-c", swap, str(root)], stderr=subprocess.DEVNULL)
    came = 0
    try:
        for number in range(1000):  # on a busy machine the link may stand in the way at every look for a while
            if came >= 2 and number >= 60:
                break
            place, machine = Place(root=str(root), path="x/f"), Machine()
            got = b""
            with contextlib.suppress(CollectFailed):
                whole = number % 2
                pieces = fetch_tar(machine, place, (), 20_480) if whole else fetch_file(machine, place, 8, 0)
                got = b"".join(pieces)
            assert b"secret" not in got, number
            came += b"harmless" in got
    finally:
        swapping.kill()
        swapping.wait()
    assert came


def test_a_transfer_that_was_cut_goes_on_where_it_ended(root: Path, tmp_path: Path) -> None:
    for name in ("big", "bigger"):
        (root / name).write_bytes(os.urandom(300_000))
    machine = Machine(100_000, 50_000, 1)
    found = brought(root, tmp_path / "home", machine=machine)
    assert found["big"].name == "big" and found["bigger"].name == "bigger"
    assert 600_000 < machine.sent < 620_000, "nothing came twice"
    assert (tmp_path / "home" / "big").read_bytes() == (root / "big").read_bytes()


def test_a_large_file_goes_on_at_whole_mebibytes_when_the_controller_died(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bringing, "_LARGE", 1 << 20)
    (root / "bag").write_bytes(os.urandom(5_000_000))
    dying = Machine(3_500_000)

    def die(_script: str) -> None:
        if len(dying.scripts) == 3:  # it would go on after the listing and the first part
            raise KeyboardInterrupt

    dying.before = die
    with pytest.raises(KeyboardInterrupt):
        brought(root, tmp_path / "home", machine=dying)
    (part,) = (tmp_path / "parts").iterdir()
    assert part.stat().st_size == 3_500_000
    machine = Machine()
    assert brought(root, tmp_path / "home", machine=machine)["bag"].name == "bag"
    assert machine.sent == 5_000_000 - (3 << 20)
    assert (tmp_path / "home" / "bag").read_bytes() == (root / "bag").read_bytes()
    assert list((tmp_path / "parts").iterdir()) == []


class Trickle(Machine):
    """A robot whose connections end after a few bytes from some stream on, until its link is mended."""

    def __init__(self, *cuts: int) -> None:
        super().__init__(*cuts)
        self.slow = True

    def open_shell(self, script: str) -> Any:
        if self.slow and not self.cuts:
            self.cuts = [1]
        return super().open_shell(script)


@pytest.mark.parametrize("large", [True, False])
def test_what_came_over_a_link_that_trickles_stays_and_the_next_call_goes_on(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: bool
) -> None:
    """Nothing is wrong on the robot, so neither a part of a large file nor whole small ones are given up."""
    monkeypatch.setattr("srprov.execution.collect.Pace", lambda: Pace(0.5))
    names = ["bag"] if large else [f"{number:02d}" for number in range(40)]
    for name in names:
        (root / name).write_bytes(os.urandom(3_500_000 if large else 10_000))
    monkeypatch.setattr(bringing, "_LARGE", 1 << 20)
    machine = Trickle(2_500_000 if large else 200_000)
    found = brought(root, tmp_path / "home", machine=machine)
    came = [name for name in names if found[name].name]
    notes = {one.note for one in found.values() if one.failed}
    assert len(notes) == 1 and "what came of it is kept" in notes.pop()
    assert len(came) == 0 if large else 10 < len(came) < 30
    machine.slow, machine.sent, machine.cuts = False, 0, []
    again = brought(root, tmp_path / "home", machine=machine)
    assert not any(one.failed for one in again.values())
    assert all((tmp_path / "home" / name).read_bytes() == (root / name).read_bytes() for name in names)
    assert machine.sent == 3_500_000 - (2 << 20) if large else machine.sent < 300_000


def test_a_result_that_changed_and_then_went_is_nothing(root: Path, tmp_path: Path) -> None:
    """Whoever needs it misses it; whoever does not goes on."""
    (root / "state").write_text("1")
    machine = Machine()

    def change(script: str) -> None:
        if "sha256sum" not in script:
            (root / "state").write_text("22")
        elif len(machine.scripts) > 1:
            (root / "state").unlink()

    machine.before = change
    mounts = {"Mounts": [{"Destination": "/out", "Source": str(root)}]}
    wanted, home = (Result(path="/out/state"),), Home(parts=tmp_path / "parts")
    found, brought_now = bring_results(machine, mounts, wanted, tmp_path / "home", home)
    assert found == {} and brought_now.files == 0 and len(machine.scripts) == 3


def test_a_result_has_what_lies_in_other_mounts_in_it(root: Path, tmp_path: Path) -> None:
    """A volume in a volume is an empty folder there; of one that hides a file the container saw only what it has."""
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "best.bag").write_text("all that was measured")
    (root / "state.json").write_text("{}")
    (root / "logs").mkdir()
    (root / "logs" / "best.bag").write_text("hidden")
    mounts = {"Mounts": [
        {"Destination": "/out", "Source": str(root), "RW": True},
        {"Destination": "/out/logs", "Source": str(inner), "RW": True},
        {"Destination": "/out/maps", "Source": str(inner), "RW": False},
    ]}  # fmt: skip
    logs, out = Result(path="/out/logs", required=True), Result(path="/out")
    for number, wanted in enumerate(((logs, out), (out, logs), (out,), (logs,))):
        home = tmp_path / str(number)
        found, came = bring_results(Machine(), mounts, wanted, home, Home(parts=home / "parts"))
        assert found.keys() == set(wanted) and came.files == 1 + (out in wanted)
        assert (home / "out/logs/best.bag").read_text() == "all that was measured" and not (home / "out/maps").exists()
        names = [one.name for one in found[wanted[0] if len(wanted) == 1 else out]]
        assert names == (["state.json", "logs/best.bag"] if out in wanted else ["best.bag"])


def test_a_mount_in_a_mount_in_a_result_comes_too(root: Path, tmp_path: Path) -> None:
    for name in ("logs", "deep"):
        (tmp_path / name / "deep").mkdir(parents=True)
        (tmp_path / name / "a.bag").write_text(name)
        (tmp_path / name / "deep/hidden.bag").write_text("the container did not see it where another mount lies")
    places = {"/out": root, "/out/logs": tmp_path / "logs", "/out/logs/deep": tmp_path / "deep"}
    mounts = {"Mounts": [{"Destination": name, "Source": str(source)} for name, source in places.items()]}
    home = tmp_path / "home"
    found, _ = bring_results(Machine(), mounts, (Result(path="/out"),), home, Home(parts=home / "parts"))
    names = sorted(one.name for one in found[Result(path="/out")])
    assert names == ["logs/a.bag", "logs/deep/a.bag", "logs/deep/deep/hidden.bag"]
    assert (home / "out/logs/deep/a.bag").read_text() == "deep"


def test_a_container_of_more_mounts_than_it_can_have_is_read_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An engine that lies names 65,000, each of which hides what lies below it of all others: minutes for nothing."""
    every = [{"Destination": "/out", "Source": "/v"}]
    every += [{"Destination": f"/out/{number}", "Source": "/"} for number in range(65_000)]
    mounts = {"Mounts": every[:1000]}
    there = [Entry(path=f"{number}/a", kind="f", sha256="0" * 64) for number in range(10_000)]
    monkeypatch.setattr(
        results, "listings", lambda _robot, places: [sorted(there) if one.root == "/v" else [] for one in places]
    )
    monkeypatch.setattr(results, "Bringing", Nothing)

    def bring() -> int:
        found, _ = bring_results(Machine(), mounts, (Result(path="/out"),), tmp_path, Home(parts=tmp_path))
        return len(found[Result(path="/out")])

    assert bounded(bring) == 9_001
    mounts["Mounts"] = every
    with pytest.raises(CollectFailed, match="more than 1000 mounts"):
        bounded(bring)


class Nothing:
    """Files that are here already."""

    fetched_files = fetched_bytes = 0

    def __init__(self, *_words: object) -> None: ...

    def all(self, entries: list[Entry]) -> list[Kept]:
        return [Kept(path=one.path) for one in entries]


def test_a_mount_that_a_robot_names_as_no_folder_can_be_is_not_brought(root: Path, tmp_path: Path) -> None:
    places = {"/out": str(root), f"/out/{'x' * 300}": str(root)}
    mounts = {"Mounts": [{"Destination": name, "Source": source} for name, source in places.items()]}
    with pytest.raises(CollectFailed, match="no folder here can have the name of its mount"):
        bring_results(Machine(), mounts, (Result(path="/out"),), tmp_path / "a/b/c", Home(parts=tmp_path / "parts"))


def test_a_mount_is_where_its_path_leads_however_a_robot_spells_it(root: Path, tmp_path: Path) -> None:
    """Two slashes are one: what lay there was no result's."""
    mounts = [{"Destination": at, "Source": f"/{at[-1]}"} for at in ("//out", "out/x//b", "/out/../../c", "/out/./d/")]
    assert place_of({"Mounts": mounts}, "/out/f") == Place(root="/t", path="f")
    assert [at for at, _ in places_below({"Mounts": mounts}, "/out")] == ["d", "x/b"]
    assert place_of({"Mounts": mounts}, "/c/f") == Place(root="/c", path="f")
    outside = {"Mounts": [{"Destination": "/out/../../../etc", "Source": str(root)}]}
    assert bring_results(Machine(), outside, (Result(path="/out"),), tmp_path / "c", Home(parts=tmp_path / "parts"))
    assert not any((tmp_path / "c").rglob("*"))


def test_a_mount_whose_source_holds_a_nul_is_none() -> None:
    """No word of a shell holds one: it ended the run of all trials."""
    mounts = [{"Destination": "/r", "Source": "/x\0y"}, {"Destination": "/r/in", "Source": "/x\0y"}]
    assert place_of({"Mounts": mounts}, "/r/a") is None
    assert places_below({"Mounts": mounts}, "/r") == []
    assert place_of({"Mounts": [*mounts, {"Destination": "/r", "Source": "/x"}]}, "/r/a") == Place(root="/x", path="a")


def test_a_part_that_was_damaged_here_is_fetched_anew(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bringing, "_LARGE", 1 << 20)
    (root / "bag").write_bytes(content := os.urandom(3_000_000))
    (tmp_path / "parts").mkdir()
    for damaged in (b"\0" * (2 << 20), b"\0" * (4 << 20)):  # of another content; longer than the file
        (tmp_path / "parts" / hashlib.sha256(content).hexdigest()).write_bytes(damaged)
        assert not brought(root, tmp_path / "home")["bag"].failed
        assert (tmp_path / "home" / "bag").read_bytes() == content
        (tmp_path / "home" / "bag").unlink()


def test_only_what_is_missing_or_changed_comes(root: Path, tmp_path: Path) -> None:
    for number in range(60):
        (root / f"{number}.txt").write_text(f"{number}" * 1000)
    (root / "line\nfeed").write_text("x")
    (root / "trailing ").write_text("y")
    (root / "trailing").write_text("z")
    brought(root, tmp_path / "home")
    machine = Machine()
    assert not any(one.failed for one in brought(root, tmp_path / "home", machine=machine).values())
    assert machine.sent == 0, "all is here"
    (tmp_path / "home" / "3.txt").unlink()
    (root / "4.txt").write_text("changed")
    machine = Machine()
    brought(root, tmp_path / "home", machine=machine)
    assert machine.sent == 1000 + len("changed"), "two files come, each alone"
    for number in range(30):
        (root / f"{number}.txt").write_text("new")
    (root / "trailing").write_text("zz")
    machine = Machine()
    found = brought(root, tmp_path / "home", machine=machine)
    assert not any(one.failed for one in found.values())
    assert 0 < machine.sent < 90_000, "of 60 files half come, in one stream"
    for name, one in found.items():
        assert (tmp_path / "home" / one.name).read_bytes() == (root / name).read_bytes()


def test_a_file_that_changes_all_the_time_is_named_and_the_others_come(root: Path, tmp_path: Path) -> None:
    (root / "still").write_text("still")
    machine, count = Machine(), itertools.count()
    machine.before = lambda _script: (root / "log").write_text(f"line {next(count)}")
    found = brought(root, tmp_path / "home", machine=machine)
    assert (found["still"].name, next(count)) == ("still", 4), "both are listed and fetched, and once more"
    changed = found["log"]
    assert changed.failed and changed.note == "it changed while it was read" and not changed.name


def test_a_file_that_grows_comes_as_it_was_or_is_named(root: Path, tmp_path: Path) -> None:
    """It comes where nothing was written between the look at its size and the end of the hash."""
    (root / "still").write_text("still")
    (root / "log").write_text("a line\n")
    over = threading.Event()

    def write() -> None:
        with (root / "log").open("a") as stream:
            while not over.is_set():
                stream.write("a line\n")
                stream.flush()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        found = brought(root, tmp_path / "home")
    finally:
        over.set()
        writer.join()
    assert found["still"].name == "still"
    grown = found["log"]
    if grown.failed:
        assert grown.note == "it changed while it was read" and not grown.name
    else:
        came = (tmp_path / "home" / grown.name).read_bytes()
        assert len(came) == grown.size and (root / "log").read_bytes().startswith(came)


def test_a_file_that_is_replaced_by_a_link_or_a_pipe_after_its_listing_is_not_followed(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "decoy").write_text("secret")
    for name in ("small", "pipe", "large"):
        (root / name).write_text("harmless" * (1 if name != "large" else 1000))
    monkeypatch.setattr(bringing, "_LARGE", 5000)

    def swap(script: str) -> None:
        if "sha256sum" not in script:
            for name in ("small", "large", "pipe"):
                (root / name).unlink(missing_ok=True)
            (root / "small").symlink_to(tmp_path / "decoy")
            (root / "large").symlink_to(tmp_path / "decoy")
            os.mkfifo(root / "pipe")

    machine = Machine()
    machine.before = swap
    found = bounded(lambda: brought(root, tmp_path / "home", machine=machine), cpu_s=2)
    assert not list((tmp_path / "home").rglob("*"))
    assert found["small"].note == f"a link to {tmp_path}/decoy" == found["large"].note
    assert found["pipe"].note == "neither file nor folder nor link"


@pytest.mark.parametrize(
    ("real", "said", "why"),
    [
        (b"f 8 ./a", b"f 9 ./a", "it changed"),
        (b"f 8 ./a", b"f 1 ./a", "it changed"),
        (b"f 8 ./a", b"f 999999999999999 ./a", "there is no room"),
        (b"f 8 ./a", b"f 8 ./../../../decoy", "it changed|it could not be read"),
        (b"f 8 ./a", b"f 8 /etc/passwd", "line that is none"),
        (b"f 8 ./a", b"f -8 ./a", "line that is none"),
        (b"H\0", b"", "line that is none"),
        (b"=0\0", b"", "not whole"),
        (hashlib.sha256(b"harmless").hexdigest().encode(), b"0" * 64, "it changed"),
        (hashlib.sha256(b"harmless").hexdigest().encode(), b"g" * 64, "hash that is none"),
    ],
)
def test_a_listing_that_lies_brings_nothing_and_is_named(
    root: Path, tmp_path: Path, real: bytes, said: bytes, why: str
) -> None:
    (root / "a").write_text("harmless")
    (tmp_path / "decoy").write_text("harmless")
    machine = Machine()
    machine.lie = lambda out: out.replace(real, said)
    try:
        found = brought(root, tmp_path / "home", machine=machine)
        told = [one.note for one in found.values() if one.failed]
    except CollectFailed as error:
        told = [str(error)]
    assert told and any(part in one for one in told for part in why.split("|")), told
    assert not any(one.is_file() for one in (tmp_path / "home").rglob("*"))


def test_a_listing_without_end_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srprov.execution.listing.MOST_FILES", 1000)
    listing = Listing(1)
    with pytest.raises(ListingError, match="more than 1000 files"):
        listing.feed(b"".join(b"f 1 ./%d\0\0" % number for number in range(1001)))
    monkeypatch.setattr("srprov.execution.listing.MOST_BYTES", 10_000)
    with pytest.raises(ListingError, match="more than 0 MiB"):
        Listing(1).feed(b"x" * 9000)


def test_a_listing_ends_when_all_its_places_have_ended() -> None:
    """Each end without a place took memory: sixteen MiB of them, 750 MiB and 17 s."""
    with pytest.raises(ListingError, match="goes on behind its end"):
        Listing(2).feed(b"H\0=0\0=1\0=0\0")
    whole = Listing(2)
    whole.feed(b"f 1 ./a\0\0H\0=0\0H\0=1\0")
    assert [status for status, _ in whole.all()] == [0, 1]
    with pytest.raises(ListingError, match="goes on behind its end"):
        whole.feed(b"f 1 ./b\0")


@pytest.mark.parametrize("what", ["files", "links"])
def test_names_that_are_no_text_take_little_memory(what: str, tmp_path: Path) -> None:
    """Each byte of them is six characters in JSON: with 60 MiB of them, and with files that failed, gigabytes."""
    name = b"\xff" * 240
    words = [b"%c 1 ./%07d%b\0%b\0" % (b"fl"[what == "links"], n, name, name) for n in range(120_000)]

    def read() -> int:
        found = Listing(1)
        try:
            for word in words:
                found.feed(word)
            found.feed(b"H\0=0\0")
        except ListingError as error:
            assert "the names of its files have more than" in str(error)
        kept = [_listed(one, Names()) for one in found._entries.values() or found._done[0][1]]
        document = {"results": [listed(one) for one in kept], "failed": [f"{one.path}: {one.note}" for one in kept]}
        private.replace_json(tmp_path / "collected.json", document)
        return len(kept)

    assert 0 < bounded(read) < 20_000


def test_a_folder_where_a_file_should_be_is_said(root: Path, tmp_path: Path) -> None:
    (root / "a").write_text("file")
    (root / "b").write_text("file")
    (tmp_path / "home" / "a").mkdir(parents=True)
    (tmp_path / "home" / "a" / "x").write_text("mine")
    found = brought(root, tmp_path / "home")
    assert found["a"].failed and "cannot be put here" in found["a"].note
    assert found["b"].name == "b" and (tmp_path / "home" / "a" / "x").read_text() == "mine"


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("/out/a.json", Place(root="/v/1", path="a.json")),
        ("/out", Place(root="/v/1", path=".")),
        ("/out/deep/x", Place(root="/v/2", path="x")),
        ("/outside", None),
        ("/", None),
    ],
)
def test_where_a_containers_path_lies(path: str, expected: Place | None) -> None:
    mounts = [{"Destination": "/out", "Source": "/v/1"}, {"Destination": "/out/deep/", "Source": "/v/2"}, 3, {}]
    assert place_of({"Mounts": mounts}, path) == expected
    assert place_of({"Mounts": "x"}, path) is None


def test_of_more_mounts_than_are_looked_at_none_is_known_not_to_be_there() -> None:
    """An image may add volumes to those of the EDF, and an engine lists them in any order."""
    volumes = [{"Type": "volume", "Destination": f"/v/{n}", "Source": f"/s/{n}"} for n in range(1000)]
    out = {"Type": "bind", "Destination": "/out", "Source": "/srv/data"}
    assert place_of({"Mounts": [*volumes[1:], out]}, "/out") == Place(root="/srv/data", path=".")
    for look in (place_of, places_below):
        with pytest.raises(CollectFailed, match="more than 1000 mounts: where its results lie cannot be told"):
            look({"Mounts": [*volumes, out]}, "/out")


def test_a_robot_s_own_path_is_read_where_it_led_when_the_container_was_made() -> None:
    mounts = [
        {"Type": "bind", "Source": "/srv/maps", "Destination": "/m"},
        {"Type": "bind", "Source": "/srv/logs", "Destination": "/m/logs"},
        {"Type": "volume", "Source": "/srv/v", "Destination": "/v"},
    ]
    led = {"/srv/maps": "/mnt/maps", "/srv/v": "/elsewhere", "/srv/other": "x"}
    inspected = {"Mounts": mounts, "Config": {"Labels": {LED: json.dumps(led)}}}
    assert place_of(inspected, "/m/a") == Place(root="/srv/maps", path="a", real="/mnt/maps")
    assert places_below(inspected, "/m") == [("logs", Place(root="/srv/logs", path="."))]  # nobody knows
    assert place_of(inspected, "/v") == Place(root="/srv/v", path=".")
    for odd in ("", "[", "[1]", '{"/srv/maps": 1}', '{"/srv/maps": "maps"}'):
        assert place_of({**inspected, "Config": {"Labels": {LED: odd}}}, "/m") == Place(root="/srv/maps", path=".")


@pytest.mark.soak
@pytest.mark.timeout(600)
def test_100_000_files_take_some_seconds_and_little_memory(root: Path, tmp_path: Path) -> None:
    """Every tenth has a name that is escaped here. Again with all of them here, and with half of them."""
    for number in range(100_000):
        name = f"{number:06d}" if number % 10 else f"{number:06d}\n:*?"
        (root / f"{number % 100:02d}").mkdir(exist_ok=True)
        (root / f"{number % 100:02d}" / name).write_text(str(number))

    def all_of_them() -> int:
        return sum(bool(one.name) and not one.failed for one in brought(root, tmp_path / "home").values())

    seconds = []
    for kept in (100_000, 100_000, 50_000):
        for number in range(kept, 100_000):
            (root / f"{number % 100:02d}" / (f"{number:06d}" if number % 10 else f"{number:06d}\n:*?")).write_text(
                "new"
            )
        begun = time.monotonic()
        assert bounded(all_of_them, cpu_s=60) == 100_000
        seconds.append(time.monotonic() - begun)
    assert max(seconds) < 300, seconds
    assert (tmp_path / "home" / "11" / "099911").read_text() == "new"
