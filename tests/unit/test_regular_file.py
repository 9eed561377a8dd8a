"""Whatever lies where a file is expected: it is read within its limit, or refused in words, and at once."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from srprov import regular_file
from tests.bounded import bounded


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one of each kind: short paths, as sockets need them."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    os.mkdir("folder")
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("socket")
    Path("file").write_bytes(b"12345")
    with open("sparse", "wb") as stream:
        stream.truncate(10**12)
    os.symlink("loop", "loop")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("pipe", "it is a pipe, not a file"),
        ("socket", "it is a socket, not a file"),
        ("/dev/zero", "it is a device, not a file"),
        ("folder", "Is a directory"),
        ("sparse", "it is larger than 8 MiB"),
        ("none", "No such file"),
        ("loop", "Too many levels"),
        ("a\0b", "no file can have such a name"),
        ("\ud800", "no file can have such a name"),
    ],
)
def test_what_is_no_file_of_the_size_is_refused(here: Path, name: str, says: str) -> None:
    for read in (regular_file.read, regular_file.read_text):
        with pytest.raises(OSError) as caught:
            bounded(lambda read=read: read(name), cpu_s=0.5)
        assert says in caught.value.strerror


def test_a_large_file_is_in_memory_once(here: Path) -> None:
    """Sparse ones cost whoever sends them nothing."""
    os.truncate("sparse", 200 << 20)
    assert bounded(lambda: len(regular_file.read("sparse", 256 << 20))) == 200 << 20


def test_a_file_is_read_up_to_its_limit(here: Path) -> None:
    assert regular_file.read("file", 5) == b"12345"
    with pytest.raises(OSError, match="it is larger than 4 bytes"):
        regular_file.read("file", 4)
    assert regular_file.beginning("file", 2) == b"12"
    assert regular_file.beginning("sparse", 3) == b"\0\0\0"
    with pytest.raises(OSError, match="it is a pipe"):
        regular_file.beginning("pipe", 3)


def test_a_file_of_the_kernels_that_tells_no_size_has_the_limit_too() -> None:
    assert os.stat("/proc/self/status").st_size == 0
    assert regular_file.read("/proc/self/status").startswith(b"Name:")
    with pytest.raises(OSError, match="it is larger than 10 bytes"):
        regular_file.read("/proc/self/status", 10)


def test_what_is_no_utf8_is_no_text(here: Path) -> None:
    Path("file").write_bytes(b"\xff")
    with pytest.raises(OSError, match="it is not UTF-8 text"):
        regular_file.read_text("file")
    assert regular_file.read_text("file", errors="replace") == "\ufffd"


def test_a_pipe_that_takes_a_files_place_meanwhile_does_not_hang(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    about = os.stat("file")
    monkeypatch.setattr(os, "stat", lambda path, **_: about)
    with pytest.raises(OSError, match="it is a pipe"):
        regular_file.read("pipe")
