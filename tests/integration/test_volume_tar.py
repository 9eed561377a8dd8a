"""What robots run to copy a volume, in a real shell with a real tar; `docker` only tells where a volume lies."""

from __future__ import annotations

import io
import os
import stat
import subprocess
import tarfile
from pathlib import Path

import pytest

from srprov.transport.volume_copy import _hash_of, _into, _most, _out, _place, _read, _room_of, _size_of
from srprov.wire import CopyVolume, Reply


class Places:
    """Folders that count as volumes."""

    def __init__(self, root: Path) -> None:
        self.root = root
        program = root / "bin" / "docker"
        program.parent.mkdir()
        program.write_text(f'#!/bin/sh\nfor last; do :; done\ntest -d "{root}/$last" && echo "{root}/$last"\n')
        program.chmod(0o755)
        self.env = {**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"}

    def volume(self, name: str) -> Path:
        (self.root / name).mkdir()
        return self.root / name

    def run(self, script: str, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(
            ["sh", "-c", script], input=data, capture_output=True, env=self.env, timeout=60, check=False
        )

    def hash(self, name: str) -> str:
        return self.run(_hash_of(name, 60).script).stdout.decode()[:64]


@pytest.fixture
def places(tmp_path: Path) -> Places:
    return Places(tmp_path)


def test_what_was_copied_has_the_same_hash_and_what_differs_has_not(places: Places) -> None:
    """A mode, a time, a link or a byte makes another hash; a folder that cannot be read has never the same twice."""
    source, target = places.volume("source"), places.volume("target")
    (source / "file").write_text("text")
    (source / "empty").mkdir()
    (source / "link").symlink_to("file")
    done = places.run(_into("target"), places.run(_out("source")).stdout)
    assert done.stdout == b"ready\ndone\n", done
    same = places.hash("source")
    assert len(same) == 64 and same == places.hash("target")
    for change in (
        lambda: (target / "file").chmod(0o600),
        lambda: os.utime(target / "file", ns=(0, 1)),
        (target / "empty").rmdir,
        lambda: (target / "more").symlink_to("x"),
    ):
        change()
        assert places.hash("target") not in (same, ""), change
        same = places.hash("target")
    assert places.hash("absent") == "", "there is no such volume"


def test_an_archive_of_a_robot_that_lies_leaves_its_folder_nowhere(places: Places) -> None:
    """Links that lead out and files behind them, names with `..` and `/`, hard links: none gets out."""
    outside = places.volume("outside")
    (outside / "own").write_text("own")
    target = places.volume("target")
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w") as tar:

        def add(name: str, kind: bytes = tarfile.REGTYPE, link: str = "") -> None:
            info = tarfile.TarInfo(name)
            info.type, info.linkname, info.size = kind, link, 4 if kind == tarfile.REGTYPE else 0
            tar.addfile(info, io.BytesIO(b"evil") if info.size else None)

        for name, link in (("a", str(outside)), ("b", "../outside"), ("c", "b")):
            add(name, tarfile.SYMTYPE, link)
            add(f"{name}/{name}")
        add("../outside/dots")
        add(f"{outside}/absolute")
        add("hard", tarfile.LNKTYPE, str(outside / "own"))
        add("hard")
    done = places.run(_into("target"), data.getvalue())
    assert b"done" not in done.stdout, "such an archive is a failure"
    assert sorted(one.name for one in outside.iterdir()) == ["own"]
    assert (outside / "own").read_text() == "own"
    assert target.is_dir() and not target.is_symlink()


def linked_last(folder: Path, name: str, *, first: bool) -> bytes:
    """Give an archive whose hard link tar makes last, by a name of which a part has become a link to a folder.

    GNU tar 1.34 begins with the latest of the links that it has left for the end. Where a version begins with the
    first one, that one's placeholder has to be there by its inode, which the link in its place may have got.
    """
    data, away = io.BytesIO(), [("p", tarfile.SYMTYPE, str(folder))]
    links = [
        ("p", tarfile.SYMTYPE, "b"),
        (f"p/{name}", tarfile.SYMTYPE, "/nowhere"),
        ("x", tarfile.LNKTYPE, f"p/{name}"),
    ]
    links = [*away, *links] if first else [*links, *away]
    with tarfile.open(fileobj=data, mode="w") as tar:
        for member, kind, link in (("b", tarfile.DIRTYPE, ""), *links, (f"b/{name}", tarfile.REGTYPE, "")):
            info = tarfile.TarInfo(member)
            info.type, info.linkname, info.mode = kind, link, 0o755
            tar.addfile(info)
    return data.getvalue()


@pytest.mark.parametrize("first", [False, True])
def test_a_hard_link_that_tar_makes_last_reaches_no_file_of_the_robot(places: Places, first: bool) -> None:
    """It was a second name, in the volume, of any file on its disk: who may write there wrote into that one."""
    own = places.volume("outside") / "own"
    own.write_text("own")
    target = places.volume("target")
    places.run(_into("target"), linked_last(own.parent, own.name, first=first))
    assert (own.stat().st_nlink, own.read_text()) == (1, "own")
    found = target / "x"
    assert not found.exists() or found.stat().st_ino != own.stat().st_ino


def test_what_cannot_be_closed_off_takes_nothing(places: Places) -> None:
    """A robot without unshare says so, before anything is sent to it."""
    places.volume("target")
    program = places.root / "bin" / "unshare"
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    done = places.run(_into("target"))
    assert (done.returncode, done.stdout) == (1, b"") and b"cannot be closed off" in done.stderr, done


def test_an_archive_of_a_robot_that_lies_takes_little_memory_of_another(places: Places) -> None:
    """Attributes of three GiB are not waited for: tar would keep them all in memory."""
    target = places.volume("target")
    info = tarfile.TarInfo("x")
    info.type, info.size = tarfile.XHDTYPE, 3 << 30
    done = places.run(_into("target"), info.tobuf(tarfile.GNU_FORMAT) + b"30 a=" + bytes(1 << 20))
    assert b"done" not in done.stdout and b"memory" in done.stderr.lower(), done
    assert list(target.iterdir()) == []


def test_robots_say_how_large_data_is_and_how_much_room_there_is(places: Places) -> None:
    """What is sparse takes less of the disk than it is long; a tar of it is no longer than both and its names."""
    source = places.volume("source")
    places.volume("target")
    (source / "full").write_bytes(os.urandom(1 << 20))
    with (source / "sparse").open("wb") as stream:
        stream.truncate(50 << 20)
    os.link(source / "full", source / "link\nwith two lines")
    size, room = (places.run(one.script) for one in (_size_of("source"), _room_of("target")))
    disk, long, names = (int(line.split("\t")[0]) for line in size.stdout.decode().splitlines())
    assert 1024 <= disk < 10 * 1024 < 51 * 1024 <= long < 52 * 1024 and names == 5, size
    most, problem = _most(CopyVolume(volume="v", into="v", source_host="r"), *map(_reply, (size, room)))
    assert not problem and most >= len(places.run(_out("source")).stdout)


def _reply(done: subprocess.CompletedProcess[bytes]) -> Reply:
    return Reply(status=done.returncode, out=done.stdout.decode(), err=done.stderr.decode(), ok=done.returncode == 0)


@pytest.mark.skipif(os.geteuid() != 0, reason="who is not root makes no devices")
def test_what_reads_a_volume_opens_no_device_and_follows_nothing_out(places: Places, tmp_path: Path) -> None:
    """What a container puts there while it is read: root would open a disk's number, or a file of the robot."""
    source = places.volume("source")
    (source / "file").write_text("text")
    look = "cat ./disk; cat ./out; ls /etc/shadow; id -un >/dev/null; : >./new"
    os.mknod(source / "disk", 0o600 | stat.S_IFCHR, os.makedev(1, 5))
    (source / "out").symlink_to("/etc/shadow")
    done = places.run(_place("source") + _read(look))
    assert done.returncode != 0 and not done.stdout and done.stderr.count(b"\n") == 4, done
    assert not (source / "new").exists()
    (source / "disk").unlink()
    for script in (_out("source"), _size_of("source").script, _hash_of("source", 60).script):
        refused = places.run(f"unshare() {{ return 1; }}; {script}")
        assert b"its folder cannot be closed off" in refused.stderr, refused
