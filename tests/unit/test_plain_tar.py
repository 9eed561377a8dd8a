"""Tars from others: read as `tarfile` wrote them, or refused; never slowly."""

from __future__ import annotations

import io
import subprocess
import tarfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov import plain_tar
from srprov.images.context import context_tar
from srprov.images.plan import ContextFile
from srprov.images.tag import read_context
from srprov.modules.tree import plain_digest
from tests.bounded import within

LONG = "long/" * 30 + "ä" * 120


def written(*entries: tuple[str, bytes, int, bytes | str]) -> bytes:
    """Return a tar as srprov's are: of path, type, mode, and content or link."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for path, kind, mode, what in entries:
            info = tarfile.TarInfo(path)
            info.type, info.mode = kind, mode
            content = what if isinstance(what, bytes) else b""
            info.linkname, info.size = what if isinstance(what, str) else "", len(content)
            tar.addfile(info, io.BytesIO(content))
    return out.getvalue()


def header(size: bytes) -> bytes:
    """Return a header of a file with the field for its size, and the right sum."""
    block = bytearray(tarfile.TarInfo("Dockerfile").tobuf(tarfile.GNU_FORMAT))
    block[124:136], block[148:156] = size, b" " * 8
    block[148:156] = b"%06o\0 " % sum(block)
    return bytes(block)


EVERY = [
    ("d", tarfile.DIRTYPE, 0o755, b""),
    ("d/empty", tarfile.REGTYPE, 0o644, b""),
    ("d/file", tarfile.REGTYPE, 0o755, b"x" * 513),
    ("d/link", tarfile.SYMTYPE, 0o644, "../" + LONG),
    (LONG, tarfile.REGTYPE, 0o644, b"0"),
    ("d/half\udcff", tarfile.REGTYPE, 0o644, b"1"),
]


def test_what_is_written_is_read_byte_for_byte() -> None:
    """Names of any length and alphabet, links, folders, files that fill no block."""
    found = list(plain_tar.members(written(*EVERY)))
    assert [(one.path, one.mode, one.content, one.link) for one in found] == [
        (path, mode, what if kind == tarfile.REGTYPE else None, what if kind == tarfile.SYMTYPE else None)
        for path, kind, mode, what in EVERY
    ]
    assert list(plain_tar.members(written())) == []


@pytest.mark.parametrize(
    "size", [b"\xff" * 10 + b"\xfe\x00", b"\xff" * 12, b"\x80" + b"\0" * 10 + b"\1", b"-0000001000\0", b"77777777777\0"]
)
def test_a_size_that_cannot_be_neither_hangs_nor_sends_anyone_back(size: bytes) -> None:
    """Negative, in base 256, beyond the end."""
    tar = tarfile.TarInfo("Dockerfile").tobuf(tarfile.GNU_FORMAT) + header(size) + b"\0" * 1024
    with within(4):
        assert read_context(tar) == ("", "") and plain_digest(tar) == ""
        with pytest.raises(ValueError, match="tar"):
            list(plain_tar.members(header(size) + b"\0" * 9728))


@settings(deadline=None)
@given(st.integers(0, 6 * 512), st.binary(min_size=1, max_size=12))
def test_a_changed_tar_is_refused_or_is_another_tar_of_the_same_form(at: int, what: bytes) -> None:
    """Whatever is read is what `tarfile` would write."""
    whole = written(*EVERY[:4])
    tar = whole[:at] + what + whole[at + len(what) :]
    try:
        found = list(plain_tar.members(tar))
    except ValueError:
        return
    kinds = {True: tarfile.DIRTYPE, False: tarfile.REGTYPE}
    again = [
        (one.path, kinds[one.is_folder] if one.link is None else tarfile.SYMTYPE, one.mode,
         one.link if one.link is not None else one.content or b"") for one in found
    ]  # fmt: skip
    assert written(*again) == tar


def test_what_lies_behind_the_end_or_between_blocks_is_refused() -> None:
    """No program that unpacks it finds anything else in it."""
    whole = written(EVERY[0], ("d/one", tarfile.REGTYPE, 0o644, b"1"))
    other = written(("d/two", tarfile.REGTYPE, 0o644, b"2"))
    inside = bytearray(whole)
    inside[1600] = 1
    for tar in (whole + other, whole + b"\0" * 512, whole[:-512], whole[:-1] + b"1", bytes(inside), whole[1:]):
        with pytest.raises(ValueError, match="tar"):
            list(plain_tar.members(tar))
        assert plain_digest(tar) == ""


@pytest.mark.parametrize(
    "paths",
    [["a", "a/b/c"], ["a", "a"], ["/a"], ["a", "a/../b"], ["a", "a/."], ["a", "a//b"], ["..", "../b"], ["a", "b"]],
)
def test_a_tree_has_one_top_and_plain_paths(paths: list[str]) -> None:
    """So nothing of it lies where it should not."""
    assert plain_digest(written(*((path, tarfile.DIRTYPE, 0o755, b"") for path in paths))) == ""


def test_what_lies_below_a_link_is_no_tree() -> None:
    """A mount would follow it."""
    top = ("d", tarfile.DIRTYPE, 0o755, b"")
    link, below = ("d/l", tarfile.SYMTYPE, 0o644, "/etc"), ("d/l/passwd", tarfile.REGTYPE, 0o644, b"")
    assert plain_digest(written(top, link)) and not plain_digest(written(top, link, below))
    assert not plain_digest(written(("l", tarfile.SYMTYPE, 0o644, "/etc")))


@pytest.mark.parametrize("top", ["ä\0b", "x" * 120 + "\0b"])
def test_a_name_that_ends_elsewhere_for_the_next_reader_is_refused(top: str, tmp_path: Path) -> None:
    """GNU tar ends a name at a NUL: the link below the one folder would take that folder's place, and lead to `/`."""
    folder, file = (top, tarfile.DIRTYPE, 0o755, b""), (f"{top}/file", tarfile.REGTYPE, 0o644, b"x")
    tar = written(folder, (f"{top}/link", tarfile.SYMTYPE, 0o755, "/"))
    subprocess.run(["tar", "-xf", "-", "-C", str(tmp_path)], input=tar, check=True)
    assert [one.is_symlink() for one in tmp_path.iterdir()] == [True], "so it is unpacked on a robot"
    link = ("d/link", tarfile.SYMTYPE, 0o755, f"{LONG}\0x")
    for strange in (tar, written(folder), written(folder, file), written(EVERY[0], link)):
        assert (plain_digest(strange), read_context(strange)) == ("", ("", ""))
        with pytest.raises(ValueError, match="no file can have"):
            list(plain_tar.members(strange))


def test_a_context_is_read_back_as_it_was_written_and_no_other_is() -> None:
    """Order, folders and modes are those that `context_tar` gives."""
    entries = [ContextFile(path="a/b/c", content=b"1"), ContextFile(path="a/l", link="x", mode=0o777)]
    tag, text = read_context(context_tar("FROM x\n", entries))
    assert tag and text == "FROM x\n"
    docker = ("Dockerfile", tarfile.REGTYPE, 0o644, b"FROM x\n")
    folder, file = ("a", tarfile.DIRTYPE, 0o755, b""), ("a/f", tarfile.REGTYPE, 0o644, b"")
    assert read_context(written(docker, folder, file))[0]
    for other in (
        [folder, file],
        [file, docker],
        [docker, file],
        [docker, folder],
        [folder, file, docker],
        [docker, ("a", tarfile.DIRTYPE, 0o700, b""), file],
        [("Dockerfile", tarfile.REGTYPE, 0o755, b"FROM x\n")],
        [("Dockerfile", tarfile.SYMTYPE, 0o644, "x")],
    ):
        assert read_context(written(*other)) == ("", "")


def test_many_members_and_deep_paths_cost_little() -> None:
    """As many as a plan file may hold, and paths of thousands of parts."""
    many = b"".join(tarfile.TarInfo(f"f{at}").tobuf(tarfile.PAX_FORMAT) for at in range(200)) * 100
    deep = written(*[("a/" * 4000 + str(at), tarfile.REGTYPE, 0o644, b"") for at in range(20)])
    with within(2):
        assert plain_digest(many) == "" and plain_digest(deep) == ""


def test_one_context_of_a_thousand_images_is_looked_at_once() -> None:
    """As in a plan file whose images all name one blob."""
    context = context_tar("FROM x\n", [ContextFile(path=f"f{at}") for at in range(2000)])
    before = read_context.cache_info().misses
    assert {read_context(context) for _ in range(1000)} == {read_context(context)}
    assert read_context.cache_info().misses == before + 1
