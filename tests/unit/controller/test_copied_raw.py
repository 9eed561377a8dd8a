"""A tar of a container's for whoever unpacks it: nothing in it goes elsewhere than it says."""

from __future__ import annotations

import io
import itertools
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.controller.copied import Copied
from srprov.controller.copied_raw import passed_on
from srprov.errors import UsageError

Entry = tuple[str, bytes, str]
"""Name, kind, and where it leads; a file holds its name."""
FOLDER, FILE, LINK, SECOND = tarfile.DIRTYPE, tarfile.REGTYPE, tarfile.SYMTYPE, tarfile.LNKTYPE


def made(*entries: Entry, form: int = tarfile.PAX_FORMAT, **words: str) -> bytes:
    """Return a tar; `words` stand in the extended header of each entry."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=form) as tar:
        for name, kind, link in entries:
            one = tarfile.TarInfo(name)
            one.type, one.linkname, one.mode, one.pax_headers = kind, link, 0o751, words
            one.size = len(os.fsencode(name)) if kind == FILE else 0
            tar.addfile(one, io.BytesIO(os.fsencode(name)))
    return buffer.getvalue()


def pieces(tar: bytes) -> Iterator[bytes]:
    """Yield it in pieces that end anywhere."""
    yield from (tar[at : at + 777] for at in range(0, len(tar), 777))


def passed(tar: bytes, name: str = "map") -> list[tarfile.TarInfo]:
    """Return the entries of what is passed on."""
    with tarfile.open(fileobj=io.BytesIO(b"".join(passed_on(pieces(tar), name, Copied())))) as read:
        return read.getmembers()


TOP = ("map", FOLDER, "")


@pytest.mark.parametrize(
    "entries",
    [
        [TOP, ("map/tiles", LINK, "/app"), ("map/tiles/step.sh", FILE, "")],
        [TOP, ("map/tiles", LINK, "/app"), ("map/tiles", FOLDER, ""), ("map/tiles/step.sh", FILE, "")],
        [TOP, ("map/d", FOLDER, ""), ("map/d", LINK, "/app"), ("map/d/step.sh", FILE, "")],
        [TOP, ("map/d", FOLDER, ""), ("map/./d", LINK, "/app")],
        [TOP, ("map/d/step.sh", FILE, "")],
        [TOP, ("map/../app/step.sh", FILE, "")],
        [TOP, ("app/step.sh", FILE, "")],
        [TOP, ("../step.sh", FILE, "")],
        [TOP, ("map/sh", SECOND, "/bin/sh")],
        [TOP, ("map/sh", SECOND, "map/../bin/sh")],
        [TOP, ("map/l", LINK, "/app/step.sh"), ("map/sh", SECOND, "map/l")],
        [("map", LINK, "/app")],
        [("map", LINK, "/app"), ("map/step.sh", FILE, "")],
        [("map", FILE, ""), ("map/step.sh", FILE, "")],
        [TOP, ("map/x", tarfile.CONTTYPE, "")],
        [TOP, ("map/x", tarfile.GNUTYPE_SPARSE, "")],
        [TOP, ("map/x", b"V", "")],
    ],
)
def test_no_entry_of_a_tar_that_is_passed_on_lies_elsewhere(entries: list[Entry]) -> None:
    """What an engine unpacks in a container follows links of that tar to wherever they lead in the container."""
    with pytest.raises(UsageError, match="what the container's engine sends is not understood"):
        passed(made(*entries))


def test_the_top_has_the_name_that_the_user_copies_whatever_a_robot_calls_it() -> None:
    """With `bin`, and a target of `/`, the programs of the other container were replaced."""
    tar = made(("bin", FOLDER, ""), ("bin/sh", FILE, ""), ("bin/ash", SECOND, "bin/sh"))
    assert [(one.name, one.linkname) for one in passed(tar)] == [("map", ""), ("map/sh", ""), ("map/ash", "map/sh")]
    assert [one.name for one in passed(made(("/", FOLDER, ""), ("/etc", FOLDER, "")), "")] == [".", "etc"]


def test_what_readers_read_otherwise_is_written_anew() -> None:
    """GNU's headers have no prefix: to who reads them so, the file lies elsewhere. Here it lies where it says."""
    tar = bytearray(made(TOP, ("map/d", FOLDER, ""), ("step.sh", FILE, ""), form=tarfile.GNU_FORMAT))
    header = memoryview(tar)[1024:1536]
    header[345:350] = b"map/d"
    header[148:156] = b"%06o\0 " % (256 + sum(header[:148]) + sum(header[156:]))
    got = b"".join(passed_on(pieces(bytes(tar)), "map", Copied()))
    assert b"GNU" not in got and all(got[at + 257 : at + 263] == b"ustar\0" for at in (0, 512, 1024))
    assert [one.name for one in passed(bytes(tar))] == ["map", "map/d", "map/d/step.sh"]


def test_no_device_is_passed_on_and_that_is_told() -> None:
    """One of a robot that lies, with the number of another robot's disk, was in that one's volume."""
    copied = Copied()
    tar = made(TOP, ("map/disk", tarfile.BLKTYPE, ""), ("map/tty", tarfile.CHRTYPE, ""), ("map/f", FILE, ""))
    with tarfile.open(fileobj=io.BytesIO(b"".join(passed_on(pieces(tar), "map", copied)))) as read:
        assert read.getnames() == ["map", "map/f"]
    assert copied.lost and copied.left_out == ["map/disk: a device", "map/tty: a device"]


def test_an_honest_tar_says_the_same(tmp_path: Path) -> None:
    """With links of any kind, long names and such that are no text, owners, times and attributes."""
    long, odd = "x" * 150, os.fsdecode(b"n\xff\xe4")
    tar = made(
        TOP, ("map/out", LINK, "/nowhere"), (f"map/{long}", FOLDER, ""), (f"map/{long}/{long}", FILE, ""),
        (f"map/{odd}", FILE, ""), ("map/second", SECOND, f"map/{odd}"), ("map/pipe", tarfile.FIFOTYPE, ""),
        **{"uid": "3000000", "mtime": "1600000000.25", "SCHILY.xattr.user.a": "b", "comment": "y"},
    )  # fmt: skip
    with tarfile.open(fileobj=io.BytesIO(tar)) as read:
        before = read.getmembers()
    after = passed(tar)
    for was, now in itertools.zip_longest(before, after):
        for field in ("name", "type", "linkname", "size", "mode", "uid", "mtime"):
            assert getattr(was, field) == getattr(now, field), field
        assert now.pax_headers["SCHILY.xattr.user.a"] == "b" and "comment" not in now.pax_headers
    with tarfile.open(fileobj=io.BytesIO(b"".join(passed_on(pieces(tar), "map", Copied())))) as read:
        read.extractall(tmp_path, [one for one in read if one.isreg() or one.isdir()], filter="data")
    assert (tmp_path / "map" / long / long).read_text() == f"map/{long}/{long}"
