"""Robots in memory whose engines find layers by chain id as a classic store does, with a real shell for spools.

`docker save` and `docker load` are programs that read and write files of the robot's folder; what `load` was given is
unpacked when somebody looks at the engine next.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from srprov.layers import chain_ids
from srprov.session import Progress, Streams, Traffic
from srprov.transport.shell.pipes import PipeStreams
from srprov.wire import EngineQuery, Query, Reply

INFO = {"Driver": "vfs", "DriverStatus": [["Backing Filesystem", "extfs"]], "DockerRootDir": "/var/lib/docker"}
CONTAINERD = [["driver-type", "io.containerd.snapshotter.v1"]]
"""`DriverStatus` of the other store."""
_DOCKER = """#!/bin/sh
case $1 in
  save) cat "$ROBOT/saved.tar" ;;
  load) shift 3; echo x >>"$ROBOT/loads"; cp "$1" "$ROBOT/loaded.tar"; cat "$ROBOT/said" 2>/dev/null || true ;;
  *) exit 1 ;;
esac
"""


def sha(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


class Made:
    """An image of some layers."""

    def __init__(self, *layers: bytes, architecture: str = "") -> None:
        self.layers, self.architecture = layers, architecture
        self.diff_ids = [sha(one) for one in layers]
        known = {"architecture": architecture} if architecture else {}
        self.config = json.dumps({**known, "rootfs": {"type": "layers", "diff_ids": self.diff_ids}}).encode()
        self.id = sha(self.config)

    def saved(self, tags: Sequence[str] = ()) -> bytes:
        """Give the archive of `docker save`."""
        names = [f"{one.removeprefix('sha256:')}/layer.tar" for one in self.diff_ids]
        entry = {"Config": f"{self.id[7:]}.json", "RepoTags": list(tags) or None, "Layers": names}
        files = {f"{self.id[7:]}.json": self.config, **dict(zip(names, self.layers, strict=True))}
        return tar_of({**files, "manifest.json": json.dumps([entry]).encode()})


class InContainerd(Made):
    """An image as a containerd store has it: known by a manifest, or by an index, with compressed layers."""

    def __init__(self, *layers: bytes, index: bool = False, architecture: str = "") -> None:
        super().__init__(*layers, architecture=architecture)
        self.packed = [gzip.compress(one, 6) for one in layers]
        layers_of = [{"digest": sha(one)} for one in self.packed]
        self.manifest = json.dumps({"config": {"digest": self.id}, "layers": layers_of})
        proof = json.dumps({"config": {"digest": sha(b"{}")}, "layers": []})
        elsewhere = {"digest": sha(b"of another platform")}
        manifests = [elsewhere, {"digest": sha(proof.encode())}, {"digest": sha(self.manifest.encode())}]
        self.index = json.dumps({"manifests": manifests}) if index else self.manifest
        self.documents = [self.config, b"{}", *(one.encode() for one in (self.manifest, proof, self.index))]
        self.config_id, self.id = self.id, sha(self.index.encode())

    def saved(self, tags: Sequence[str] = ()) -> bytes:
        """Give the archive of `docker save`: an OCI layout, with a list as older engines have it."""
        names = [f"blobs/sha256/{sha(one)[7:]}" for one in self.packed]
        entry = {"Config": f"blobs/sha256/{self.config_id[7:]}", "RepoTags": list(tags) or None, "Layers": names}
        files = {f"blobs/sha256/{sha(one)[7:]}": one for one in (*self.documents, *self.packed)}
        return tar_of({**files, "oci-layout": b"{}", "manifest.json": json.dumps([entry]).encode()})


def tar_of(files: dict[str, bytes]) -> bytes:
    """Give a tar of files."""
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w") as archive:
        for name, content in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return target.getvalue()


class Robot:
    """A robot as `copy_image` needs it."""

    def __init__(self, name: str, folder: Path, *, spools: bool = True) -> None:
        self.host, self.folder, self.spools = name, folder / name, spools
        self.identity = f"{name} key"
        self.images: dict[str, Made] = {}
        self.info: dict[str, Any] = dict(INFO)
        self.free_kib, self.shells, self.streamed, self.saves = 1 << 30, list[str](), list[int](), 0
        self.lost: set[str] = set()
        """Chains that the engine loses after it was looked at."""
        self.unlisted: list[Made] = []
        """Whose layers the engine keeps, as a container has them, and which it does not list any more."""
        self.engine = SimpleNamespace(client=SimpleNamespace(load=self._load))
        (self.folder / "bin").mkdir(parents=True)
        (self.folder / "bin/docker").write_text(_DOCKER, encoding="utf-8")
        (self.folder / "bin/docker").chmod(0o755)
        self.before: Callable[[Robot], None] = lambda _robot: None
        """Called before each shell."""

    @property
    def spool(self) -> str:
        """Where it keeps images that are under way."""
        return f"{self.folder}/state/.images"

    def ask(self, queries: Sequence[Any]) -> list[Reply]:
        """Answer as shell and engine do."""
        return [self._answer(one) for one in queries]

    def _answer(self, query: Query | EngineQuery) -> Reply:
        if isinstance(query, Query):
            line = f"/dev/sda1 0 0 {self.free_kib} 0% /\n"
            return Reply(status=0, out=line * 2)
        self._take_loaded()
        if query.path == "/info":
            return _json(self.info)
        if query.path == "/images/json":
            return _json([{"Id": one.id} for one in self.images.values()])
        name = query.path.removeprefix("/images/").removesuffix("/json")
        found = self.images.get(name) or next((one for one in self.images.values() if one.id == name), None)
        if found is None:
            return Reply(status=404, ok=False, err="no such image")
        said = self.says or found.architecture
        return _json({"Id": found.id, "Architecture": said, "RootFS": {"Type": "layers", "Layers": found.diff_ids}})

    says = ""
    """The architecture that the engine says images are for, instead of what they are."""

    def save_image(self, name: str, _timeout_s: float) -> Iterator[bytes]:
        """Stream an image."""
        self.saves += 1
        tags = [tag for tag, one in self.images.items() if name in (tag, one.id)]
        content = self.saved or self.images[tags[0]].saved([name])
        return iter([content[at : at + 100_000] for at in range(0, len(content), 100_000)])

    saved = b""
    """What the engine saves instead of what it should."""

    def open_shell(self, script: str) -> Streams:
        """Run it, in a folder and with an engine of its own."""
        self.before(self)
        self.shells.append(script)
        if not self.spools:
            script = "echo 'no it has no place for that'; echo"
        image = next(iter(self.images.values()), None)
        if image is not None:
            (self.folder / "saved.tar").write_bytes(self.saved or image.saved())
        script = script.replace("/var/lib/srprov", f"{self.folder}/state")
        return PipeStreams(f"PATH={self.folder}/bin:$PATH ROBOT={self.folder}; export PATH ROBOT\n{script}", Traffic())

    def _load(self, pieces: Iterator[bytes], _timeout_s: float, _progress: Progress) -> Reply:
        archive = b"".join(pieces)
        self.streamed.append(len(archive))
        why = self._unpack(archive)
        return Reply(status=200, ok=not why, err=why)

    def _take_loaded(self) -> None:
        loaded = self.folder / "loaded.tar"
        if loaded.exists():
            self._unpack(loaded.read_bytes())
            loaded.unlink()

    def _unpack(self, archive: bytes) -> str:
        """Do as moby's `image/tarexport/load.go`: layers that are there are not looked for in the archive."""
        with tarfile.open(fileobj=io.BytesIO(archive)) as read:
            files = {name: file.read() for name in read.getnames() if (file := read.extractfile(name))}
        layers = {chain: layer for one in (*self.images.values(), *self.unlisted)
                  for chain, layer in zip(chain_ids(one.diff_ids), one.layers, strict=True)
                  if chain not in self.lost}  # fmt: skip
        for entry in json.loads(files["manifest.json"]):
            document = json.loads(files[entry["Config"]])
            config = document["rootfs"]["diff_ids"]
            found = []
            for chain, diff_id, name in zip(chain_ids(config), config, entry["Layers"], strict=True):
                if chain not in layers and name not in files:
                    return f"open /var/lib/docker/tmp/{name}: no such file or directory"
                layer = layers[chain] if chain in layers else files[name]
                layer = gzip.decompress(layer) if layer[:2] == b"\x1f\x8b" else layer
                if sha(layer) != diff_id:
                    return f"invalid diffID for layer: expected {diff_id}, got {sha(layer)}"
                found.append(layer)
            made = Made(*found, architecture=document.get("architecture", ""))
            assert made.config == files[entry["Config"]]
            self.images |= dict.fromkeys(entry["RepoTags"], made)
        return ""


def _json(value: object) -> Reply:
    return Reply(status=200, out=json.dumps(value))
