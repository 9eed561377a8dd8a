"""Container images, written straight into a registry's storage without any Docker.

Takes layers as tar files, writes blobs, manifests and tags the way the `docker-registry`
(Distribution) filesystem driver lays them out. Images are in Docker's "schema 2" form, which
every engine reads; layers stay uncompressed, because the robots unpack on this machine's own
processors and fetch over its own bridge.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

KIND = "application/vnd.docker."
ARCHITECTURES = {
    "x86_64": "amd64",
    "aarch64": "arm64",
    "armv7l": "arm",
    "i686": "386",
    "riscv64": "riscv64",
}
EPOCH = "1970-01-01T00:00:00Z"


class Image(msgspec.Struct, frozen=True):
    """What becomes `name:tag` (e.g. `library/debian:bookworm`)."""

    name: str
    tag: str
    layers: Sequence[Path]
    """Tar files, lowest first. They are moved into the storage."""
    command: Sequence[str]
    environment: Mapping[str, str] = msgspec.field(default_factory=dict)
    architecture: str = ""
    """In the words of container images; empty: this machine's."""


class Storage:
    """The folder of a registry's filesystem driver, written while no registry serves it."""

    def __init__(self, root: Path) -> None:
        """`root` is the registry's `rootdirectory`."""
        self.top = root / "docker/registry/v2"

    def add(self, image: Image, *more: Image) -> str:
        """Write an image, or one for each architecture under one name; gives the digest of its manifest."""
        written = [self._write(each) for each in (image, *more)]
        digest = written[0][0]
        if more:
            parts = [
                _part("distribution.manifest.v2+json", each, size) | {"platform": {"architecture": arch, "os": "linux"}}
                for each, size, arch in written
            ]
            kind = f"{KIND}distribution.manifest.list.v2+json"
            digest = self._write_blob(_json({"schemaVersion": 2, "mediaType": kind, "manifests": parts}))
        revisions = {digest, *(each for each, _, _ in written)}
        for each in sorted(revisions):
            self._link(image.name, [f"_manifests/revisions/sha256/{each}"], each)
        tag = f"_manifests/tags/{image.tag}"
        self._link(image.name, [f"{tag}/current", f"{tag}/index/sha256/{digest}"], digest)
        return digest

    def _write(self, image: Image) -> tuple[str, int, str]:
        """Write one image's blobs; gives its manifest's digest and size, and its architecture."""
        sizes = [layer.stat().st_size for layer in image.layers]
        layers = [self._move_blob(layer) for layer in image.layers]
        config_text = json.dumps(_config(image, layers), sort_keys=True).encode()
        config = self._write_blob(config_text)
        manifest = {
            "schemaVersion": 2,
            "mediaType": f"{KIND}distribution.manifest.v2+json",
            "config": _part("container.image.v1+json", config, len(config_text)),
            "layers": [_part("image.rootfs.diff.tar", layer, size) for layer, size in zip(layers, sizes, strict=True)],
        }
        text = _json(manifest)
        self._link(image.name, [f"_layers/sha256/{each}" for each in (config, *layers)])
        return self._write_blob(text), len(text), image.architecture or architecture()

    def _blob(self, digest: str) -> Path:
        path = self.top / "blobs/sha256" / digest[:2] / digest / "data"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def _move_blob(self, source: Path) -> str:
        sum_so_far = hashlib.sha256()
        with source.open("rb") as stream:
            while chunk := stream.read(2**20):
                sum_so_far.update(chunk)
        digest = sum_so_far.hexdigest()
        os.replace(source, self._blob(digest))
        return digest

    def _write_blob(self, content: bytes) -> str:
        digest = hashlib.sha256(content).hexdigest()
        self._blob(digest).write_bytes(content)
        return digest

    def _link(self, name: str, places: Sequence[str], digest: str = "") -> None:
        for place in places:
            path = self.top / "repositories" / name / place / "link"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"sha256:{digest or Path(place).name}")


def _part(kind: str, digest: str, size: int) -> dict[str, object]:
    return {"mediaType": KIND + kind, "size": size, "digest": f"sha256:{digest}"}


def _json(document: object) -> bytes:
    return json.dumps(document, indent=3).encode()


def architecture() -> str:
    """This machine's architecture in the words of container images."""
    return ARCHITECTURES.get(platform.machine(), platform.machine())


def _config(image: Image, layers: Sequence[str]) -> dict[str, object]:
    path = "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    environment = [path, *(f"{name}={value}" for name, value in sorted(image.environment.items()))]
    return {
        "architecture": image.architecture or architecture(),
        "os": "linux",
        "created": EPOCH,
        "config": {"Cmd": list(image.command), "Env": environment},
        "rootfs": {"type": "layers", "diff_ids": [f"sha256:{layer}" for layer in layers]},
        "history": [{"created": EPOCH, "created_by": "srprov lab"} for _ in layers],
    }
