"""Images in memory, a run whose containers had them, and its bundle with them."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import tarfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from srprov.controller.bundle_images import Read
from srprov.evidence.make import bundle
from srprov.evidence.make_images import Wish
from srprov.transport.blob import Blob
from tests.trial_folders import run_folder, write_experiment

STATUS = """\
Package: curl
Status: install ok installed
Architecture: amd64
Version: 7.88.1-10

Package: vim
Status: deinstall ok config-files
Architecture: amd64
Version: 9.0-1
"""
DEBIAN = {"etc/os-release": 'ID=debian\nVERSION_ID="12"\n', "var/lib/dpkg/status": STATUS, "bin/sh": "#!"}
_NUMPY = "usr/lib/python3/dist-packages/numpy-1.26.4.dist-info"
NUMPY = {
    f"{_NUMPY}/METADATA": "Metadata-Version: 2.1\nName: numpy\nVersion: 1.26.4\n",
    f"{_NUMPY}/INSTALLER": "pip\n",
}


def sha(data: bytes) -> str:
    return f"sha256:{hashlib.sha256(data).hexdigest()}"


def layer(files: Mapping[str, str | bytes], *, format: int = tarfile.PAX_FORMAT) -> bytes:
    """Return a layer's tar."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w", format=format) as tar:
        for name, content in files.items():
            data = content.encode() if isinstance(content, str) else content
            one = tarfile.TarInfo(name)
            one.size = len(data)
            tar.addfile(one, io.BytesIO(data))
    return out.getvalue()


@dataclass(frozen=True)
class Image:
    """An image of some layers."""

    layers: tuple[bytes, ...]
    environment: tuple[str, ...] = ()
    architecture: str = "amd64"

    @property
    def config(self) -> bytes:
        about = {
            "architecture": self.architecture, "os": "linux", "config": {"Env": list(self.environment)},
            "rootfs": {"type": "layers", "diff_ids": [sha(one) for one in self.layers]},
        }  # fmt: skip
        return json.dumps(about).encode()

    @property
    def id(self) -> str:
        return sha(self.config)


RUNNER = Image((layer(DEBIAN), layer(NUMPY)))
JUDGE = Image((layer(DEBIAN), layer({"judge": "law"})))


class Engine:
    """Whoever has images."""

    def __init__(self, folder: Path, *images: Image) -> None:
        self.folder, self.images = folder, {one.id: one for one in images}
        self.asked: list[tuple[str, ...]] = []

    def read(self, image: str, words: str, first: Sequence[str], say: object, names: Collection[str] = ()) -> Read:
        self.asked.append((words, *first))
        one = self.images[image]
        return Read(config=one.config, documents=(one.config,), layers=tuple(map(self.blob, dict.fromkeys(one.layers))))

    def blob(self, content: bytes) -> Blob:
        path = self.folder / f"{sha(content)[7:]}.gz"
        path.write_bytes(gzip.compress(content, 1))
        return Blob(sha(content), path, path.stat().st_size, len(content), sha(path.read_bytes()))


def run_with(home: Path, runner: Image = RUNNER, judge: Image = JUDGE) -> Path:
    """Write the folder of a run whose containers had these images, by the word of robots and journal."""
    folder = run_folder(home / "run", write_experiment(home / "experiment"))
    ids = {"runner": runner.id, "referee": judge.id}
    for path in folder.glob("trials/*/containers.json"):
        text = path.read_text()
        for service, id_ in ids.items():
            text = text.replace(sha(service.encode()), id_)
        path.write_text(text)
    first, *rest = (folder / "journal.jsonl").read_text().splitlines(keepends=True)
    event = json.loads(first)
    event["same"] |= {f"{service}: image id": id_ for service, id_ in ids.items()}
    (folder / "journal.jsonl").write_text(json.dumps(event) + "\n" + "".join(rest))
    return folder


def bundled_with(folder: Path, target: Path, *images: Image, way: str = "all", no_secret: tuple[str, ...] = ()) -> Path:
    """Bundle a run with its images."""
    spool = target.parent / "engine"
    spool.mkdir(exist_ok=True)
    wish = Wish(way=way, giver=Engine(spool, *(images or (RUNNER, JUDGE))), say=lambda _text: None)
    bundle(folder, target, images=wish, no_secret=no_secret)
    return target
