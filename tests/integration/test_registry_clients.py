"""Clients of others pull from the registry, through a port that a real sshd forwards: containerd, skopeo and podman.

skopeo and podman are Debian's packages, unpacked into a folder: nothing is installed. Docker's own pull is in
`tests/lab/test_registry_copy.py`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.layers import Image
from srprov.session import no_progress
from srprov.transport.blob import Blob
from srprov.transport.blobs import Blobs
from srprov.transport.image_config import configuration
from srprov.transport.image_source import ImageSources
from srprov.transport.registry import answer
from srprov.transport.registry_image import ServedImage
from srprov.transport.ssh_session import SshSession
from tests.unit.transport.test_registry import an_image, tar_of
from tests.unit.transport.thin_world import Made, Robot

from .sshd import usable
from .test_reverse import listens, robot

pytestmark = [pytest.mark.soak, pytest.mark.skipif(not usable(), reason="needs root and openssh-server")]

__all__ = ["robot"]
PACKAGES = ("skopeo", "podman", "conmon", "libgpgme11", "libsubid4")
LIMIT_S = 120


def run(*words: str, **environment: str) -> str:
    done = subprocess.run(
        words, capture_output=True, text=True, timeout=LIMIT_S, env={**os.environ, **environment}, check=False
    )
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with Debian's packages in it."""
    folder = tmp_path_factory.mktemp("debian")
    subprocess.run(["apt-get", "download", *PACKAGES], cwd=folder, check=True, timeout=LIMIT_S, capture_output=True)
    for package in folder.glob("*.deb"):
        run("dpkg-deb", "-x", str(package), str(folder))
    (folder / "policy.json").write_text('{"default": [{"type": "insecureAcceptAnything"}]}')
    return folder


@pytest.fixture
def containerd(tmp_path: Path) -> Iterator[str]:
    """Give the socket of a containerd of its own."""
    config, socket = tmp_path / "containerd.toml", tmp_path / "c.sock"
    config.write_text('version = 2\ndisabled_plugins = ["io.containerd.grpc.v1.cri"]\n')
    folders = ["--root", str(tmp_path / "root"), "--state", str(tmp_path / "state"), "--address", str(socket)]
    with (tmp_path / "log").open("wb") as log:
        daemon = subprocess.Popen(["containerd", "--config", str(config), *folders], stdout=log, stderr=log)
    try:
        until = time.monotonic() + 20
        while not socket.exists():
            assert daemon.poll() is None and time.monotonic() < until, (tmp_path / "log").read_text()
            time.sleep(0.05)
        yield str(socket)
    finally:
        daemon.terminate()
        daemon.wait(20)


def uncounted(_digest: str, _size: int) -> None:
    """Count nothing of what goes out."""


@pytest.fixture
def image(tmp_path: Path) -> ServedImage:
    return an_image(tmp_path / "blobs", (tar_of(os.urandom(3 << 20), "base"), tar_of(os.urandom(1 << 20), "top")))


@pytest.fixture
def port(robot: Callable[..., SshSession], image: ServedImage) -> Iterator[int]:
    with robot().connection.forwards.open(
        lambda channel: answer(channel, image, lambda _digest, _size: None), 5
    ) as port:
        yield port
    assert not listens(port)


def files_of(folder: Path) -> set[str]:
    return {f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}" for path in folder.rglob("*") if path.is_file()}


def test_skopeo_podman_and_containerd_get_one_digest(
    port: int, image: ServedImage, unpacked: Path, containerd: str, tmp_path: Path
) -> None:
    reference = f"127.0.0.1:{port}/{image.name}@{image.digest}"
    library = {"LD_LIBRARY_PATH": str(unpacked / "usr/lib/x86_64-linux-gnu")}
    blobs = {image.digest, image.image.id, *(one.compressed for one in image.layers)}
    policy = ["--policy", str(unpacked / "policy.json")]

    skopeo = str(unpacked / "usr/bin/skopeo")
    copied = tmp_path / "copied"
    run(skopeo, *policy, "copy", "--src-tls-verify=false", f"docker://{reference}", f"dir:{copied}", **library)
    assert blobs <= files_of(copied)
    seen = json.loads(run(skopeo, "inspect", "--no-tags", "--tls-verify=false", f"docker://{reference}", **library))
    assert seen["Digest"] == image.digest

    assert blobs <= set(in_containerd(containerd, reference))
    assert in_podman(unpacked, tmp_path, reference, library) == [image.digest, image.image.id, *image.image.diff_ids]


def in_containerd(address: str, reference: str) -> Sequence[str]:
    ctr = ("ctr", "--address", address)
    run(*ctr, "images", "pull", "--plain-http", "--snapshotter", "native", reference)
    return run(*ctr, "content", "ls", "-q").split()


def in_podman(unpacked: Path, folder: Path, reference: str, library: dict[str, str]) -> list[str]:
    short = tempfile.mkdtemp(prefix="podman")  # it takes no path of more than 50 characters
    podman = [str(unpacked / "usr/bin/podman"), "--root", str(folder / "podman"), "--runroot", short]
    podman += ["--storage-driver", "vfs", "--conmon", str(unpacked / "usr/bin/conmon"), "--events-backend", "none"]
    policy = ["--signature-policy", str(unpacked / "policy.json")]
    run(*podman, "pull", "--quiet", "--tls-verify=false", *policy, reference, **library)
    [found] = json.loads(run(*podman, "image", "inspect", reference, **library))
    shutil.rmtree(short)
    return [found["Digest"], f"sha256:{found['Id']}", *found["RootFS"]["Layers"]]


def test_a_layer_of_random_bytes_passes_a_new_key_exchange(
    robot: Callable[..., SshSession], tmp_path: Path, unpacked: Path
) -> None:
    image = an_image(tmp_path / "blobs", (os.urandom(700 << 20),))
    library = {"LD_LIBRARY_PATH": str(unpacked / "usr/lib/x86_64-linux-gnu")}
    policy = ["--policy", str(unpacked / "policy.json")]
    copied = tmp_path / "copied"
    with robot().connection.forwards.open(
        lambda channel: answer(channel, image, lambda _digest, _size: None), 5
    ) as port:
        source = f"docker://127.0.0.1:{port}/{image.name}@{image.digest}"
        skopeo = str(unpacked / "usr/bin/skopeo")
        run(skopeo, *policy, "copy", "--src-tls-verify=false", source, f"dir:{copied}", **library)
    assert image.layers[0].compressed in files_of(copied)


def test_a_layer_with_one_wrong_byte_is_refused(port: int, image: ServedImage, unpacked: Path, tmp_path: Path) -> None:
    layer = image.layers[1]
    content = bytearray(layer.path.read_bytes())
    content[len(content) // 2] ^= 1
    layer.path.write_bytes(content)
    library = {"LD_LIBRARY_PATH": str(unpacked / "usr/lib/x86_64-linux-gnu")}
    words = [str(unpacked / "usr/bin/skopeo"), "--policy", str(unpacked / "policy.json"), "copy"]
    source = f"docker://127.0.0.1:{port}/{image.name}@{image.digest}"
    with pytest.raises(AssertionError, match=r"(?i)digest did not match|does not match"):
        run(*words, "--src-tls-verify=false", source, f"dir:{tmp_path / 'copied'}", **library)


def test_what_containerd_saves_is_read_from_a_builder(
    port: int, image: ServedImage, containerd: str, tmp_path: Path
) -> None:
    in_containerd(containerd, f"127.0.0.1:{port}/{image.name}@{image.digest}")
    saved = tmp_path / "saved.tar"
    reference = f"127.0.0.1:{port}/{image.name}@{image.digest}"
    run("ctr", "--address", containerd, "images", "export", str(saved), reference)
    builder: Any = Robot("builder", tmp_path)
    builder.saved, builder.images["srprov/x:1"] = saved.read_bytes(), Made(b"")

    def get(digest: str) -> Blob:
        return source.get(digest, "the image", no_progress)

    known = Image(image.digest, image.image.diff_ids)
    with ImageSources(Blobs(tmp_path / "cache")).source(builder, known) as source:
        found, config = configuration(known, get, classic=False)
        assert (found, b"".join(config.content())) == (replace(image.image, architecture="amd64"), image.config)
        layers = [get(one) for one in found.diff_ids]
    assert [one.compressed for one in layers] == [one.compressed for one in image.layers], "they are compressed anew"
