"""Layers of an archive are unpacked within limits, whoever packed them."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.layers import read_config
from srprov.transport import gzip_reader
from srprov.transport.blob import inflated
from srprov.transport.blobs import Blobs, WrongBlob
from srprov.transport.gzip_reader import BeyondLimits
from srprov.transport.image_archive import ForeignImage, Wanted, only
from srprov.transport.image_proof import Proof
from tests.bounded import bounded
from tests.unit.transport.archives import saved

EMPTY = gzip.compress(b"", mtime=0)
TINY = gzip.compress(bytes(100), mtime=0)


def digest_of(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def cut(data: bytes, size: int = 1 << 20) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def seen(*files: bytes, size: int = 1 << 20) -> set[str]:
    proof = Proof()
    for one in files:
        assert b"".join(proof.of(cut(one, size))) == one
    return proof.seen


def bomb(mib: int) -> bytes:
    packer = zlib.compressobj(9, wbits=31)
    return b"".join([*(packer.compress(bytes(1 << 20)) for _ in range(mib)), packer.flush()])


@pytest.mark.parametrize("size", [1, 1000, 1 << 20])
def test_a_layer_is_known_in_either_form_and_in_several_members(size: int) -> None:
    """As eStargz has them: one for each file."""
    parts = [os.urandom(3000), bytes(50_000), b"", b"x" * 512]
    packed = b"".join(map(gzip.compress, parts))
    assert seen(packed, size=size) == {digest_of(packed), digest_of(b"".join(parts))}
    for broken in (packed[:-1], packed + b"x", b"no gzip"):
        assert seen(broken, size=size) == {digest_of(broken)}


def test_one_of_real_size_is_known() -> None:
    content = hashlib.sha256()
    for _ in range(300):
        content.update(bytes(1 << 20))
    assert f"sha256:{content.hexdigest()}" in bounded(lambda: seen(bomb(300)), 10.0)


def test_members_with_nothing_in_them_have_an_end() -> None:
    """Each was a copy of all that followed it: more than a second for each MiB."""
    with pytest.raises(BeyondLimits, match="it holds next to nothing"):
        bounded(lambda: seen(EMPTY * ((8 << 20) // len(EMPTY))))


def test_neither_do_many_files_of_them() -> None:
    with pytest.raises(BeyondLimits, match="it holds next to nothing"):
        bounded(lambda: seen(*([EMPTY * 20_000] * 4000)))


def test_members_with_next_to_nothing_take_their_own_time_alone() -> None:
    bounded(lambda: seen(TINY * ((4 << 20) // len(TINY))), 3.0)


def test_what_a_few_bytes_become_has_an_end_in_all_files_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gzip_reader, "_MOST_CONTENT", 64 << 20)
    packed = bomb(40)
    assert len(seen(packed)) == 2
    with pytest.raises(BeyondLimits, match="it holds more than"):
        seen(packed, packed)
    with pytest.raises(BeyondLimits, match="it holds more than"):
        list(inflated(iter([bomb(65)])))


def test_whose_archive_it_is_is_told() -> None:
    layer = EMPTY * 100_000
    config = json.dumps({"rootfs": {"type": "layers", "diff_ids": [digest_of(b"layer")]}}).encode()
    image = read_config(digest_of(config), json.loads(config))
    assert image is not None
    archive = saved({"srprov/x:1": layer})
    with pytest.raises(ForeignImage, match="what its archive has packed is no layer: it holds next to nothing"):
        list(only(cut(archive, 1 << 20), "srprov/x:1", (), Wanted(image, image.diff_ids)))


def test_the_cache_takes_no_such_layer_either(tmp_path: Path) -> None:
    packer = zlib.compressobj(wbits=31)
    nothing = packer.compress(b"") + packer.flush(zlib.Z_FULL_FLUSH) * (4 << 20)
    with pytest.raises(WrongBlob, match="it holds next to nothing"):
        Blobs(tmp_path).add(digest_of(b""), cut(nothing))
