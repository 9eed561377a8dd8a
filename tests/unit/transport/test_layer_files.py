"""Layers that are put together from an engine's own files: what comes is the layer, or the engine saves its image."""

from __future__ import annotations

import base64
import contextlib
import gzip
import io
import json
import os
import re
import shutil
import tarfile
import time
from collections import deque
from pathlib import Path
from typing import Any

import pytest

from srprov.layers import chain_ids
from srprov.transport import layer_files
from srprov.transport.blobs import Blobs
from srprov.transport.image_source import ImageSources
from srprov.transport.image_there import image_of
from srprov.transport.layer_files import NotInFiles
from srprov.transport.tar_stream import TarError, TarStream
from tests.bounded import bounded
from tests.unit.transport.thin_world import Made, Robot

TAG = "srprov/x:1"


def tar_with(*members: tuple[str, bytes | str]) -> bytes:
    """Give a tar of files (bytes) and links (where they lead); a name that ends with a slash is a folder."""
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for name, content in members:
            member = tarfile.TarInfo(name.rstrip("/"))
            if isinstance(content, str):
                member.type, member.linkname = tarfile.SYMTYPE, content
            elif name.endswith("/"):
                member.type, member.mode = tarfile.DIRTYPE, 0o755
            else:
                member.size = len(content)
            archive.addfile(member, io.BytesIO(content) if isinstance(content, bytes) else None)
    return target.getvalue()


AWKWARD = tar_with(
    ("dir/", b""), ("dir/-x", b"dash"), ("two\nlines", b"feed"), ("dir/.wh.gone", b""), ("link", "/etc/passwd"),
    ("not utf-8 \udcff", b"bytes"), ("a" * 150 + "/", b""), ("a" * 150 + "/" + "b" * 120, b"long"),
    ("big", os.urandom(300_000)), ("../up", b""), ("/rooted", b"from the root"), ("same", b"same"), ("too", b"same"),
    ('a "name" <with> \\ & ü,[{:', b"odd"), ("empty", b""),
)  # fmt: skip
PLAIN = tar_with(("file", b"content"))


def as_go_has_it(entry: dict[str, Any]) -> str:
    """Give an entry as an engine writes it: some characters by their numbers, and all others as they are."""
    text = json.dumps(entry, separators=(",", ":"), ensure_ascii=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


class Engine:
    """The folder of an engine with overlay2."""

    def __init__(self, robot: Robot, image: Made) -> None:
        self.root, self.robot, self.temporary = robot.folder / "engine", robot, robot.folder / "tmp"
        self.temporary.mkdir()
        robot.images[TAG] = image
        robot.info |= {"Driver": "overlay2", "DockerRootDir": str(self.root)}
        configs = self.root / "image/overlay2/imagedb/content/sha256"
        configs.mkdir(parents=True)
        (configs / image.id[7:]).write_bytes(image.config)
        self.chains = chain_ids(image.diff_ids)
        for number, (chain, layer) in enumerate(zip(self.chains, image.layers, strict=True)):
            self._add(chain, image.diff_ids[number], layer, f"{number:064x}")

    def _add(self, chain: str, diff_id: str, layer: bytes, cache_id: str) -> None:
        store, diff = self.root / "image/overlay2/layerdb/sha256" / chain[7:], self.diff(cache_id)
        store.mkdir(parents=True)
        diff.mkdir(parents=True)
        (store / "cache-id").write_text(cache_id)
        (store / "diff").write_text(diff_id)
        entries, end = list[dict[str, Any]](), 0
        with tarfile.open(fileobj=io.BytesIO(layer)) as archive:
            for member in archive:
                name = member.name.encode("utf-8", "surrogateescape")
                called = {"name": member.name} if name.isascii() else {"name_raw": base64.b64encode(name).decode()}
                entries.append({"type": 2, "payload": base64.b64encode(layer[end : member.offset_data]).decode()})
                size: dict[str, Any] = (
                    {"size": member.size, "payload": "AAAAAAAAAAA="} if member.size else {"payload": None}
                )
                entries.append({"type": 1, **called, **size})
                end = member.offset_data + member.size
                if member.isreg() and ".." not in member.name:
                    path = os.fsencode(diff) + b"/" + name.lstrip(b"/")
                    os.makedirs(os.path.dirname(path), exist_ok=True)
                    Path(os.fsdecode(path)).write_bytes(layer[member.offset_data : end])
        entries.append({"type": 2, "payload": base64.b64encode(layer[end:]).decode()})
        lines = [as_go_has_it({**entry, "position": number}) for number, entry in enumerate(entries)]
        self.split(chain).write_bytes(gzip.compress("\n".join(lines).encode()))

    def diff(self, cache_id: str) -> Path:
        return self.root / "overlay2" / cache_id / "diff"

    def split(self, chain: str) -> Path:
        return self.root / "image/overlay2/layerdb/sha256" / chain[7:] / "tar-split.json.gz"

    @property
    def top(self) -> Path:
        """Where the files of the highest layer are."""
        return self.diff(f"{len(self.chains) - 1:064x}")

    def read(self, folder: Path, *, fast: bool = False) -> list[str]:
        """Get all of the image into a cache, compare it, and return what was said."""
        session: Any = self.robot
        image, said, sources = image_of(session, TAG), list[str](), ImageSources(Blobs(folder / "cache"))
        assert image is not None
        with sources.source(session, image) as source:
            for digest in (image.id, *image.diff_ids):
                blob = source.get(digest, "layer", said.append, lambda: fast)
                assert blob.digest == digest
        end = time.monotonic() + 5
        while left := [*Path(self.robot.folder, "state").rglob("*"), *self.temporary.iterdir()]:
            assert time.monotonic() < end, left
        return said

    @property
    def saved(self) -> int:
        """How often the engine saved an image."""
        return sum("docker save" in one for one in self.robot.shells)


@pytest.fixture
def engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Engine:
    made = Engine(Robot("builder", tmp_path), Made(PLAIN, AWKWARD))
    monkeypatch.setenv("TMPDIR", str(made.temporary))
    return made


@pytest.mark.parametrize("fast", [False, True])
def test_layers_with_awkward_names_come_without_the_engine_saving_the_image(
    engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fast: bool
) -> None:
    monkeypatch.setattr(layer_files, "LARGE", 100_000)
    engine.read(tmp_path, fast=fast)
    assert engine.saved == 0 and len(engine.robot.shells) == 3
    suffixes = sorted("".join(one.suffixes) for one in Path(tmp_path, "cache").iterdir())
    assert suffixes == [".gz", ".gz", ".raw.gz" if fast else ".gz"]


def test_no_link_in_a_folder_where_others_write_has_the_names_of_an_image_written_elsewhere(
    engine: Engine, tmp_path: Path
) -> None:
    """A container that mounts the robot's /tmp puts one in the place of what root makes there."""
    victim, swapping = tmp_path / "sshrc", Path(engine.robot.folder, "bin/cat")
    swap = f'for one in "$TMPDIR"/*; do [ ! -f "$one" ] || ln -sf {victim} "$one"; done'
    swapping.write_text(f'#!/bin/sh\n{swap}\nexec {shutil.which("cat")} "$@"\n')
    swapping.chmod(0o755)
    engine.read(tmp_path)
    assert not victim.exists() and engine.saved == 0


def changed(engine: Engine) -> None:
    Path(engine.top, "big").write_bytes(os.urandom(300_000))


def shorter(engine: Engine) -> None:
    Path(engine.top, "big").write_bytes(b"x")


def gone(engine: Engine) -> None:
    Path(engine.top, "big").unlink()


def a_fifo(engine: Engine) -> None:
    gone(engine)
    os.mkfifo(engine.top / "big")


def a_folder_that_leads_to_a_fifo(engine: Engine) -> None:
    elsewhere = engine.root / "elsewhere"
    elsewhere.mkdir()
    os.mkfifo(elsewhere / "-x")
    Path(engine.top, "dir").rename(engine.root / "away")
    Path(engine.top, "dir").symlink_to(elsewhere)


def no_layer(engine: Engine) -> None:
    engine.split(engine.chains[-1]).unlink()


def list_cut_off(engine: Engine) -> None:
    split = engine.split(engine.chains[-1])
    split.write_bytes(split.read_bytes()[:-30])


def no_list(engine: Engine) -> None:
    engine.split(engine.chains[-1]).write_bytes(os.urandom(500))


def a_name_that_leads_up(engine: Engine) -> None:
    entry = {"type": 1, "name": "a/../../../decoy", "size": 5, "payload": "", "position": 0}
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(as_go_has_it(entry).encode()))


def an_unknown_entry(engine: Engine) -> None:
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(b'{"type":3,"payload":"","position":0}'))


def bytes_that_are_none(engine: Engine) -> None:
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(b'{"type":2,"payload":"A","position":0}'))


def a_bomb(engine: Engine) -> None:
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(bytes(400 << 20), 1))


def too_many_entries(engine: Engine) -> None:
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(b'{"type":2,"payload":"","position":0}\n' * 3_000_000, 1))


def long_names(engine: Engine) -> None:
    lines = b"".join(
        b'{"type":1,"name":"%0*d","size":1,"payload":null,"position":0}\n' % (60_000, number) for number in range(3_000)
    )
    engine.split(engine.chains[-1]).write_bytes(gzip.compress(lines, 1))


@pytest.mark.parametrize(
    "spoil",
    [changed, shorter, gone, a_fifo, a_folder_that_leads_to_a_fifo, no_layer, list_cut_off, no_list,
     a_name_that_leads_up, an_unknown_entry, bytes_that_are_none, a_bomb, too_many_entries, long_names],
)  # fmt: skip
def test_files_that_do_not_make_the_layer_have_the_engine_save_the_image(
    engine: Engine, tmp_path: Path, spoil: Any
) -> None:
    spoil(engine)
    began = time.monotonic()
    said = engine.read(tmp_path)
    assert engine.saved == 1 and time.monotonic() - began < 30
    assert any(line.startswith("layer: its image is saved by the engine: ") for line in said), said


BETWEEN, NAMED = (
    b'{"type":2,"payload":"%b","position":0}\n',
    b'{"type":1,"name":"%b","size":1,"payload":null,"position":0}\n',
)
COSTLY = {
    "many entries": (BETWEEN % b"", layer_files._MOST_ENTRIES),
    "headers": (BETWEEN % base64.b64encode(bytes(300)), layer_files._MOST_ENTRIES),
    "names": (NAMED % b"a", layer_files._MOST_ENTRIES),
    "escaped names": (NAMED % (rb"\u0061" * 4000), 5_000),
    "long lines": (BETWEEN % (b"AAAA" * 250_000), 100),
    "long names without content": ((NAMED % (rb"\\" * 500_000)).replace(b'"size":1,', b""), 100),
    "other JSON": (BETWEEN.replace(b'"position":0', b'"x":[' + b"[]," * 300_000 + b"[]]") % b"", 100),
    "quotes": (b'{"type":1,"name":"' + b'"' * 1_000_000 + b'","payload":"","position":0}\n', 100),
}


@pytest.mark.parametrize("what", COSTLY)
def test_a_list_that_is_made_to_cost_much_costs_little(engine: Engine, tmp_path: Path, what: str) -> None:
    """For all that is read of it, twice where it goes so far."""
    line, count = COSTLY[what]
    split = gzip.compress(line * count, 1)
    assert len(split) < layer_files._MOST_PACKED

    def read() -> None:
        with contextlib.suppress(NotInFiles, TarError):
            layer_files._names(split)
        with contextlib.suppress(NotInFiles, TarError):
            deque(layer_files._tar(split, TarStream(iter(()))), maxlen=0)

    bounded(read)


def test_an_engine_that_keeps_layers_otherwise_saves_the_image(engine: Engine, tmp_path: Path) -> None:
    engine.robot.info["Driver"] = "btrfs"
    said = engine.read(tmp_path)
    assert engine.saved == 1 and any("keeps layers otherwise" in line for line in said)


def test_a_robot_whose_tar_is_another_saves_the_image(engine: Engine, tmp_path: Path) -> None:
    tar = engine.robot.folder / "bin/tar"
    tar.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "tar (busybox) 1.36" && exit\nexec /bin/tar "$@"\n')
    tar.chmod(0o755)
    said = engine.read(tmp_path)
    assert engine.saved == 1 and any("no GNU tar" in line for line in said), said


def test_what_follows_the_files_of_a_layer_is_not_read_to_its_end(
    engine: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have none."""
    monkeypatch.setattr(layer_files, "LARGE", 100_000)
    tar = engine.robot.folder / "bin/tar"
    tar.write_text('#!/bin/sh\n/bin/tar "$@"\n[ "$1" = --version ] || exec head -c 200000000 /dev/zero\n')
    tar.chmod(0o755)
    said = engine.read(tmp_path, fast=True)
    copied = [float(found[1]) for line in said if (found := re.search(r"([0-9.]+) MiB copied", line))]
    assert engine.saved == 0 and copied and max(copied) < 20
