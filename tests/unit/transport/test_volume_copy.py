"""A volume's data has an end: what its robot said of it before, and what the other one has room for."""

from __future__ import annotations

import io
import os
import subprocess
import tarfile
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from srprov.sandbox import sandboxed_writing
from srprov.transport.volume_copy import DEVICES, UNPACK, _size_of, copy_volume
from srprov.wire import CopyVolume, Query, Reply, Run, quote

MIB = 1 << 20
COPY = CopyVolume(volume="srprov.x.d", into="srprov-copy.x.d", source_host="liar")


class Shell:
    """A shell that prints without end, or one that takes everything."""

    last_words: bytes | None = None
    """With which it ends at once; or it never does."""

    def __init__(self, robot: Robot, said: bytes = b"") -> None:
        self.robot, self.said, self.ended = robot, said, False

    def read(self) -> tuple[bytes, bytes]:
        if self.last_words is not None and self.robot.host == "liar":
            self.ended = True
            return b"x" * MIB, self.last_words
        if self.robot.host == "liar":
            return b"x" * MIB, b""
        said, self.said = self.said, b""
        return said, b""

    def write(self, data: memoryview) -> int:
        self.robot.taken += len(data)
        assert self.robot.taken < 1000 * MIB, "it never ends"
        if self.robot.taken > self.robot.closed_at:
            self.robot.alive = False
        return len(data)

    def wait(self, seconds: float, *, writing: bool) -> None:
        pass

    def close(self) -> None:
        self.ended = True


class Robot:
    """A robot that says how large its data is and how much room there is."""

    def __init__(self, host: str, size: str = "", free: int = 0, closed_at: int = 1 << 60) -> None:
        self.host, self.size, self.free, self.closed_at = host, size, free, closed_at
        self.taken, self.alive = 0, True

    def execute(self, command: Run | Query) -> Reply:
        script = getattr(command, "script", "")
        if "sha256sum" in script:
            return Reply(status=0, out="0" * 64)
        if "df -P" in script:
            return Reply(status=0, out=f"/dev/vda1 999999999 1 {self.free} 1% /")
        return Reply(status=0 if self.size else 1, ok=bool(self.size), out=self.size, err="" if self.size else "no du")

    def open_shell(self, script: str) -> Shell:
        return Shell(self, b"ready\n")


def copied(size: str, free: int, closed_at: int = 1 << 60) -> tuple[Reply, Robot]:
    target: Any = Robot("target", free=free, closed_at=closed_at)
    source: Any = Robot("liar", size)
    return copy_volume(COPY, target, lambda _name: source, lambda _line: None), target


@pytest.mark.parametrize(
    ("free", "most"), [(900 * 1024, 74), (50 * 1024, 50)], ids=["what it said", "what there is room for"]
)
def test_a_robot_that_gives_more_than_it_said_is_cut_off(free: int, most: int) -> None:
    reply, target = copied("10240\t/v\n10240\t/v\n3\n", free)
    assert not reply.ok and "liar gives more than it said that it has, or than there is room for" in reply.err
    assert most - 2 <= target.taken / MIB <= most + 1


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (b"tar: ./a: Cannot open: Permission denied\nsrprov-end 2\n", ": tar: ./a: Cannot open: Permission denied"),
        (b"srprov-end 1\n", ""),
        (b"sh: out of memory", ": sh: out of memory"),
        (b"", ""),
    ],
)
def test_a_robot_that_stops_in_the_middle_is_not_waited_for(said: bytes, why: str) -> None:
    """The other one's tar waits for the rest: it did for two minutes."""
    with mock.patch.object(Shell, "last_words", said):
        reply, target = copied("10240\t/v\n10240\t/v\n3\n", 900 * 1024)
    assert not reply.ok and reply.err == f"liar did not give all of its data{why}" and target.taken == MIB


def test_what_has_no_room_or_no_size_is_not_begun() -> None:
    for size, free, why in (
        ("204800\t/v\n204800\t/v\n3\n", 100 * 1024, "there are 100 MiB free, and the data has 200 MiB"),
        ("", 100 * 1024, "liar: how large its data is cannot be told: no du"),
        ("many\n2\n3", 100 * 1024, "liar: how large its data is cannot be told"),
    ):
        reply, target = copied(size, free)
        assert not reply.ok and reply.err.startswith(why) and target.taken == 0, reply


def test_a_copy_ends_when_its_connection_is_closed() -> None:
    """As an interrupt does after the time that running steps have."""
    reply, target = copied("900000\t/v\n900000\t/v\n3\n", 900 * 1024, closed_at=20 * MIB)
    assert (reply.ok, reply.err) == (False, "its connection was closed") and target.taken < 22 * MIB


@pytest.mark.skipif(os.geteuid() != 0, reason="who is not root makes no devices")
@pytest.mark.parametrize(
    ("name", "kind", "number", "fine"),
    [
        ("map", tarfile.BLKTYPE, (254, 0), False),
        ("a\n0:0\n b/map", tarfile.CHRTYPE, (10, 229), False),
        ("-exec", tarfile.CHRTYPE, (0, 1), False),
        ("whiteout", tarfile.CHRTYPE, (0, 0), True),
        ("pipe", tarfile.FIFOTYPE, (0, 0), True),
    ],
)
def test_data_that_comes_holds_no_device_of_the_robot(
    tmp_path: Path, name: str, kind: bytes, number: tuple[int, int], *, fine: bool
) -> None:
    """A container that may open devices, or all of them, took one by the name of its data for that."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as tar:
        one = tarfile.TarInfo(name)
        one.type, (one.devmajor, one.devminor) = kind, number
        tar.addfile(one)
    script = f"root={quote(str(tmp_path))}; {sandboxed_writing(UNPACK)}"
    done = subprocess.run(["sh", "-c", script], input=buffer.getvalue(), capture_output=True, check=False, timeout=30)
    assert (done.returncode == 0, DEVICES in done.stderr.decode()) == (fine, not fine), done


def test_data_in_which_a_disk_is_mounted_is_not_moved_without_it(tmp_path: Path) -> None:
    """Both hashes would be equal, and what lies on the disk go with the volume at its source."""
    data, docker = tmp_path / "v" / "_data", tmp_path / "bin" / "docker"
    (data / "disk").mkdir(parents=True)
    docker.parent.mkdir()
    docker.write_text(f"#!/bin/sh\necho {data}\n")
    docker.chmod(0o755)

    def size() -> subprocess.CompletedProcess[str]:
        run = {**os.environ, "PATH": f"{docker.parent}:{os.environ['PATH']}"}
        words = ["sh", "-c", _size_of("v").script]
        return subprocess.run(words, env=run, capture_output=True, text=True, check=False, timeout=30)

    assert size().returncode == 0
    subprocess.run(["mount", "-t", "tmpfs", "test", data / "disk"], check=True)
    try:
        done = size()
    finally:
        subprocess.run(["umount", data / "disk"], check=True)
    assert done.returncode and "something else is mounted in it: ./disk" in done.stderr, done
