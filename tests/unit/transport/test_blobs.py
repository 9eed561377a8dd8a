"""The cache of layers: what it gives is what its name says, and it does not grow without end."""

from __future__ import annotations

import gzip
import hashlib
import itertools
import os
import stat
import threading
import tracemalloc
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from srprov.transport.blob import inflated
from srprov.transport.blobs import Blobs, WrongBlob, default_folder
from tests.bounded import bounded


def digest_of(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def test_what_was_kept_is_found_again_by_another_process_and_is_its_users_alone(tmp_path: Path) -> None:
    content = os.urandom(3 << 20) + bytes(5 << 20)
    packed = gzip.compress(content, 1)
    folder = tmp_path / "srprov" / "blobs"
    kept = Blobs(folder).add(digest_of(content), [packed[:1000], packed[1000:]])
    assert (kept.size, kept.content_size, kept.compressed) == (len(packed), len(content), digest_of(packed))
    modes = [stat.S_IMODE(one.stat().st_mode) for one in (kept.path, folder)]
    assert modes == [0o600, 0o700] and [one.name for one in folder.iterdir()] == [kept.path.name]

    found = Blobs(folder).get(digest_of(content))
    assert found == kept and gzip.decompress(b"".join(found.pieces())) == content
    assert Blobs(folder).size(digest_of(content)) == len(packed) and Blobs(folder).size(digest_of(b"")) is None


def test_a_content_without_end_does_not_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot says no size of a layer before it comes."""
    free = iter([600 << 20, 560 << 20, 500 << 20])
    monkeypatch.setattr("srprov.transport.blobs.shutil.disk_usage", lambda _path: SimpleNamespace(free=next(free)))
    packer = zlib.compressobj(0, wbits=31)
    endless = itertools.repeat(bytes(1 << 20))
    for keep, pieces in ((Blobs(tmp_path).add_content, endless), (Blobs(tmp_path).add, map(packer.compress, endless))):
        free = iter([600 << 20, 560 << 20, 500 << 20])
        with pytest.raises(OSError, match="No space left"):
            keep(digest_of(b""), pieces)
        assert list(tmp_path.iterdir()) == []


def test_a_flipped_byte_makes_a_file_unusable_and_it_is_removed(tmp_path: Path) -> None:
    content = os.urandom(100_000)
    kept = Blobs(tmp_path).add_content(digest_of(content), [content])
    changed = bytearray(kept.path.read_bytes())
    changed[50_000] ^= 1
    kept.path.write_bytes(changed)
    assert Blobs(tmp_path).get(digest_of(content)) is None and not kept.path.exists()


def test_a_file_that_changes_after_it_was_compared_is_compared_again(tmp_path: Path) -> None:
    blobs, content = Blobs(tmp_path), b"layer" * 1000
    kept = blobs.add_content(digest_of(content), [content])
    assert blobs.get(kept.digest) == kept
    kept.path.write_bytes(gzip.compress(b"another"))
    assert blobs.get(kept.digest) is None


@pytest.mark.parametrize(
    "packed",
    [
        gzip.compress(b"another"),
        gzip.compress(b"layer")[:-4],
        gzip.compress(b"layer") + b"more",
        gzip.compress(b"lay") + gzip.compress(b"er"),
        zlib.compress(b"layer"),
        b"layer",
        b"",
    ],
    ids=["another", "cut off", "more behind it", "two members", "zlib", "not compressed", "nothing"],
)
@pytest.mark.parametrize("piece", [1, 1000])
def test_only_the_content_that_the_digest_says_is_kept(tmp_path: Path, packed: bytes, piece: int) -> None:
    pieces = [packed[at : at + piece] for at in range(0, len(packed), piece)]
    with pytest.raises(WrongBlob):
        Blobs(tmp_path).add(digest_of(b"layer"), pieces)
    assert list(tmp_path.iterdir()) == []


def test_a_read_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    def broken() -> Iterator[bytes]:
        yield gzip.compress(b"layer")[:5]
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        Blobs(tmp_path).add(digest_of(b"layer"), broken())
    assert list(tmp_path.iterdir()) == []


def test_the_least_recently_used_goes_first_but_none_that_is_in_use(tmp_path: Path) -> None:
    contents = [os.urandom(1000) for _ in range(4)]
    digests = [digest_of(one) for one in contents]
    for number in range(3):
        os.utime(Blobs(tmp_path).add_content(digests[number], [contents[number]]).path, (number, number))
    assert Blobs(tmp_path).get(digests[0]) is not None, "used: now the second is the oldest"
    later = Blobs(tmp_path, most_bytes=3100)
    later.add_content(digests[3], [contents[3]])
    assert [later.size(one) is not None for one in digests] == [True, False, True, True]
    tight = Blobs(tmp_path, most_bytes=0)
    for number in (0, 1):
        tight.add_content(digests[number], [contents[number]])
    assert [tight.size(one) is not None for one in digests] == [True, True, False, False]


def test_files_that_a_killed_process_left_go_after_a_day(tmp_path: Path) -> None:
    for name, age in (("old.part", 90_000), ("new.part", 0)):
        (tmp_path / name).write_bytes(b"x")
        then = (tmp_path / name).stat().st_mtime - age
        os.utime(tmp_path / name, (then, then))
    Blobs(tmp_path).add_content(digest_of(b"a"), [b"a"])
    assert sorted(one.name for one in tmp_path.iterdir() if one.suffix == ".part") == ["new.part"]


def test_neither_a_link_nor_a_pipe_is_read_and_no_other_name_is_asked_for(tmp_path: Path) -> None:
    content = b"layer"
    name = digest_of(content).removeprefix("sha256:") + ".gz"
    (tmp_path / "elsewhere").write_bytes(gzip.compress(content))
    (tmp_path / name).symlink_to(tmp_path / "elsewhere")
    assert Blobs(tmp_path).get(digest_of(content)) is None
    (tmp_path / name).unlink()
    os.mkfifo(tmp_path / name)
    assert Blobs(tmp_path).get(digest_of(content)) is None
    with pytest.raises(ValueError, match="no sha256 digest"):
        Blobs(tmp_path).get("sha256:../../x")


def test_a_content_is_got_by_one_while_the_others_wait(tmp_path: Path) -> None:
    blobs, content, got = Blobs(tmp_path), b"layer", list[str]()

    def want() -> None:
        with blobs.turn(digest_of(content)):
            if blobs.get(digest_of(content)) is None:
                got.append(threading.current_thread().name)
                blobs.add_content(digest_of(content), [content])

    threads = [threading.Thread(target=want) for _ in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join(10)
    assert len(got) == 1


def test_what_a_few_bytes_become_is_not_held(tmp_path: Path) -> None:
    packer, digest = zlib.compressobj(9, wbits=31), hashlib.sha256()
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(64)) + packer.flush()
    for _ in range(64):
        digest.update(bytes(1 << 20))
    tracemalloc.start()
    kept = Blobs(tmp_path).add(f"sha256:{digest.hexdigest()}", [packed])
    assert tracemalloc.get_traced_memory()[1] < 8 << 20 and kept.content_size == 64 << 20
    tracemalloc.stop()


def test_the_cache_is_where_other_caches_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/some/where")
    assert default_folder() == Path("/some/where/srprov/blobs")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", "/home/x")
    assert default_folder() == Path("/home/x/.cache/srprov/blobs")


@pytest.mark.parametrize("what", ["empty blocks", "what follows the end"])
def test_gzip_that_holds_nothing_ends(what: str) -> None:
    """Blocks of nothing come without end, and zlib keeps what follows the end in memory."""
    packer = zlib.compressobj(1, wbits=31)
    begin = packer.compress(b"x" * 1000) + packer.flush(zlib.Z_FULL_FLUSH if what == "empty blocks" else zlib.Z_FINISH)
    more = b"\0\0\0\xff\xff" * 200_000 if what == "empty blocks" else bytes(1 << 20)
    taken = itertools.count()
    pieces = itertools.chain([begin], (more for _ in itertools.takewhile(lambda at: at < 1000, taken)))

    def read() -> None:
        with pytest.raises(zlib.error):
            for _ in inflated(pieces):
                pass

    bounded(read)
    tracemalloc.start()
    read()
    assert tracemalloc.get_traced_memory()[1] < 16 << 20 and next(taken) < 10
    tracemalloc.stop()


def test_no_layers_are_kept_or_removed_by_way_of_somebody_else_s_link(tmp_path: Path) -> None:
    """Layers are compared when they are read; but whatever was packed where the link led was removed for new ones."""
    mine, blobs, digest = tmp_path / "mine", Blobs(tmp_path / "srprov/blobs"), digest_of(b"layer")
    blobs.add_content(digest, [b"layer"])
    (tmp_path / "srprov").rename(tmp_path / "old")
    mine.mkdir()
    for name in ("backup.tar.gz", *(one.name for one in (tmp_path / "old/blobs").iterdir())):
        (mine / name).write_bytes(b"mine")
    (tmp_path / "srprov").mkdir()
    (tmp_path / "srprov/blobs").symlink_to(mine)
    os.lchown(tmp_path / "srprov/blobs", 65534, 65534)
    with pytest.raises(OSError, match="others may write"):
        blobs.add_content(digest, [b"layer"])
    assert blobs.get(digest) is None and blobs.total() == blobs.clear() == 0
    assert len(list(mine.iterdir())) == 2


def test_layers_may_be_kept_where_a_link_of_the_user_s_leads(tmp_path: Path) -> None:
    """To a larger disk."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "srprov").symlink_to(tmp_path / "disk")
    blobs = Blobs(tmp_path / "srprov/blobs")
    blobs.add_content(digest_of(b"layer"), [b"layer"])
    assert blobs.get(digest_of(b"layer")) is not None and blobs.clear() > 0
