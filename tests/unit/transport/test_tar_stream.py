"""Archives that a hostile robot sends: refused by their headers, before anything of them is kept."""

from __future__ import annotations

import itertools
import tarfile
from collections.abc import Callable, Iterator

import pytest

from srprov.transport.image_archive import ForeignImage, only
from tests.unit.transport.archives import loadable, saved

MIB = 1 << 20


class Sent:
    """Counts the bytes that were taken of an archive."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self.pieces, self.size = pieces, 0

    def __iter__(self) -> Iterator[bytes]:
        for piece in self.pieces:
            self.size += len(piece)
            yield piece


def header(name: str, kind: bytes, size: int = 0) -> bytes:
    found = tarfile.TarInfo(name)
    found.type, found.size = kind, size
    return found.tobuf(tarfile.USTAR_FORMAT)


def endless(kind: bytes) -> Iterator[bytes]:
    """Return a member of 600 MiB."""
    yield header("a", kind, 600 * MIB)
    yield from itertools.repeat(b"x" * MIB, 600)


def repeated(name: str, kind: bytes) -> Iterator[bytes]:
    """Return members without content that never end; a number is put into their names."""
    return (header(name.format(number), kind) for number in range(1_000_000))


@pytest.mark.parametrize(
    ("archive", "why"),
    [
        (lambda: endless(tarfile.GNUTYPE_LONGNAME), "no file that an image has"),
        (lambda: endless(tarfile.GNUTYPE_LONGLINK), "no file that an image has"),
        (lambda: endless(tarfile.XHDTYPE), "longer than 64 KiB"),
        (lambda: endless(tarfile.XGLTYPE), "no file that an image has"),
        (lambda: endless(tarfile.GNUTYPE_SPARSE), "no file that an image has"),
        (lambda: endless(tarfile.CONTTYPE), "no file that an image has"),
        (lambda: endless(tarfile.DIRTYPE), "has content"),
        (lambda: repeated("d{}", tarfile.DIRTYPE), "more than 4096 members"),
        (lambda: repeated("f{}", tarfile.REGTYPE), "more than 4096 members"),
        (lambda: repeated("manifest.json", tarfile.REGTYPE), "comes twice"),
        (lambda: repeated("index.json", tarfile.REGTYPE), "comes twice"),
        (lambda: (header(f"f{n}", tarfile.REGTYPE, 8**11 - 1) for n in range(1)), "ends too early"),
    ],
)
def test_what_is_not_in_an_image_is_refused_before_it_is_kept(archive: Callable[[], Iterator[bytes]], why: str) -> None:
    sent = Sent(archive())
    with pytest.raises(ForeignImage, match=why):
        list(only(iter(sent), "srprov/x:1"))
    assert sent.size < 4 * MIB


def extended(words: dict[str, str]) -> tarfile.TarInfo:
    found = tarfile.TarInfo("plain")
    found.pax_headers = words
    return found


def test_an_extended_header_of_an_engine_comes_through() -> None:
    """Go writes one for times below a second and for long names."""
    long = "blobs/" + "x" * 300
    whole = saved({"srprov/x:1": b"layer"}, [(extended({"path": long, "mtime": "1.5"}), b"abc")])
    passed = b"".join(only(iter([whole]), "srprov/x:1"))
    assert loadable(passed) == {"srprov/x:1": b"layer"} and b"x" * 300 in passed


def test_more_than_64_gib_are_refused_by_their_headers() -> None:
    words = extended({"size": str(65 << 30)})
    with pytest.raises(ForeignImage, match="64 GiB"):
        list(only(iter([words.tobuf(tarfile.PAX_FORMAT)]), "srprov/x:1"))


@pytest.mark.parametrize("words", [{"path": "manifest.json\0x"}, {"GNU.sparse.major": "1"}, {"size": "-1"}])
def test_a_path_that_ends_elsewhere_for_the_next_reader_is_refused(words: dict[str, str]) -> None:
    """So is what makes a file out of less than its content."""
    with pytest.raises(ForeignImage):
        list(only(iter([saved({"srprov/x:1": b"layer"}, [(extended(words), b"abc")])]), "srprov/x:1"))
