"""Results of containers are read by a real shell and tar, from a folder that others may have filled."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from srprov.errors import TransportError
from srprov.execution.collect import CollectFailed, Place, fetch, offers, place_of
from srprov.record.results import Kept, unpack
from srprov.session import Session
from srprov.wire import Query, Reply


class Shell:
    """A shell of this machine; `cut` ends its streams after so many bytes."""

    host = "robot1"

    def __init__(self, cut: int | None = None) -> None:
        self.cut, self.sent = cut, 0

    def ask(self, queries: Sequence[Query]) -> Sequence[Reply]:
        done = [subprocess.run(["sh", "-c", one.command], capture_output=True, text=True) for one in queries]
        return [Reply(status=one.returncode, out=one.stdout, err=one.stderr, ok=one.returncode == 0) for one in done]

    def open_shell(self, script: str) -> Any:
        done = subprocess.run(["sh", "-c", script], capture_output=True)
        whole = self.cut is None or len(done.stdout) <= self.cut
        out = done.stdout if whole else done.stdout[: self.cut]
        self.sent += len(out)
        return Streams(out, done.stderr if whole else b"")


class Streams:
    def __init__(self, out: bytes, err: bytes) -> None:
        self.left = [(out[at : at + 4096], b"") for at in range(0, len(out), 4096)] + [(b"", err)]

    def read(self) -> tuple[bytes, bytes]:
        return self.left.pop(0) if self.left else (b"", b"")

    @property
    def ended(self) -> bool:
        return not self.left

    def reason(self) -> str:
        return "cut"

    def wait(self, seconds: float, *, writing: bool) -> None:
        raise AssertionError("nothing is awaited here")

    def close(self) -> None:
        pass


def session(cut: int | None = None) -> Session:
    return cast(Session, Shell(cut))


def brought(root: Path, home: Path, path: str = ".") -> dict[str, Kept]:
    """Bring a folder home; return what became of each entry."""
    place = Place(root=str(root), path=path)
    (offer,) = offers(session(), [place])
    assert offer is not None
    home.mkdir()
    tar = home.parent / f"{home.name}.tar"
    with tar.open("wb") as stream:
        fetch(session(), place, stream.write)
    assert tar.stat().st_size <= offer.most
    return {one.path: one for one in unpack(tar, home)}


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
    assert list((tmp_path / "home").iterdir()) == []


def test_a_path_that_leads_out_is_refused_and_one_that_is_not_there_is_nothing(root: Path, tmp_path: Path) -> None:
    (tmp_path / "decoy").write_text("secret")
    (root / "out").symlink_to(tmp_path)
    assert offers(session(), [Place(root=str(root), path="no/such")]) == [None]
    assert offers(session(), [Place(root=str(tmp_path / "gone"), path=".")]) == [None]
    with pytest.raises(CollectFailed, match="a link leads out of its folder"):
        offers(session(), [Place(root=str(root), path="out/decoy")])


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
            if came and number >= 60:
                break
            stream = io.BytesIO()
            with contextlib.suppress(CollectFailed, TransportError):
                place = Place(root=str(root), path="x/f")
                if offers(session(), [place]) != [None]:
                    fetch(session(), place, stream.write)
            assert b"secret" not in stream.getvalue(), number
            came += b"harmless" in stream.getvalue()
    finally:
        swapping.kill()
        swapping.wait()
    assert came


def test_a_transfer_that_was_cut_goes_on_where_it_ended(root: Path, tmp_path: Path) -> None:
    (root / "big").write_bytes(os.urandom(300_000))
    place = Place(root=str(root), path=".")
    whole = bytearray()
    sent = 0
    for cut in (100_000, 50_000, None):
        shell = Shell(cut)
        if cut is None:
            fetch(cast(Session, shell), place, whole.extend, len(whole))
        else:
            with pytest.raises(TransportError, match="ended too early: cut"):
                fetch(cast(Session, shell), place, whole.extend, len(whole))
        sent += shell.sent
    assert sent == len(whole)
    (tmp_path / "home").mkdir()
    (tmp_path / "tar").write_bytes(whole)
    assert [one.path for one in unpack(tmp_path / "tar", tmp_path / "home")] == ["big"]
    assert (tmp_path / "home" / "big").read_bytes() == (root / "big").read_bytes()


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
