"""The registry over a pair of sockets: what a pull needs, and 404 for all else."""

from __future__ import annotations

import hashlib
import http.client
import io
import json
import socket
import tarfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from srprov.layers import Image
from srprov.transport import registry
from srprov.transport.blobs import Blobs
from srprov.transport.registry import answer
from srprov.transport.registry_image import ServedImage, served

Dial = Callable[[], socket.socket]
LAYERS = (b"base" * 50_000, b"top" * 70_000)


def sha256(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def tar_of(content: bytes, name: str) -> bytes:
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w") as archive:
        member = tarfile.TarInfo(name)
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    return target.getvalue()


def packed(content: bytes) -> Iterator[bytes]:
    packer = zlib.compressobj(0, wbits=31)
    for at in range(0, len(content), 1 << 20):
        yield packer.compress(content[at : at + (1 << 20)])
    yield packer.flush()


def an_image(folder: Path, layers: tuple[bytes, ...] = LAYERS) -> ServedImage:
    diff_ids = [sha256(one) for one in layers]
    config = json.dumps({"architecture": "amd64", "os": "linux", "rootfs": {"diff_ids": diff_ids}}).encode()
    cache = Blobs(folder)
    blobs = [cache.add(digest, packed(content)) for digest, content in zip(diff_ids, layers, strict=True)]
    return served(Image(sha256(config), tuple(diff_ids)), config, blobs)


@pytest.fixture
def image(tmp_path: Path) -> ServedImage:
    return an_image(tmp_path / "blobs")


@pytest.fixture
def sent() -> list[int]:
    return []


@pytest.fixture
def dial(image: ServedImage, sent: list[int]) -> Iterator[Dial]:
    """Give a function that connects to the registry, which answers in a thread."""
    ours: list[socket.socket] = []
    threads: list[threading.Thread] = []

    def serve(stream: socket.socket) -> None:
        with stream:
            answer(stream, image, lambda _digest, size: sent.append(size))

    def connect() -> socket.socket:
        here, there = socket.socketpair()
        here.settimeout(10)
        ours.append(here)
        threads.append(threading.Thread(target=serve, args=(there,)))
        threads[-1].start()
        return here

    yield connect
    for one in ours:
        one.close()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive(), "a connection outlives the one that asked"


class Client(http.client.HTTPConnection):
    """Asks over a socket that is there."""

    def __init__(self, stream: socket.socket) -> None:
        super().__init__("registry")
        self.sock = stream

    def ask(self, path: str, method: str = "GET", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
        self.request(method, path, headers=headers)
        answered = self.getresponse()
        return answered, answered.read()


@pytest.fixture
def client(dial: Dial) -> Client:
    return Client(dial())


def test_a_pull_by_digest_finds_manifest_configuration_and_layers(
    client: Client, image: ServedImage, sent: list[int]
) -> None:
    said, body = client.ask("/v2/")
    assert (said.status, said.headers["Docker-Distribution-Api-Version"], sent) == (200, "registry/2.0", [])
    said, body = client.ask(f"/v2/{image.name}/manifests/{image.digest}")
    assert said.status == 200 and sha256(body) == image.digest == said.headers["Docker-Content-Digest"]
    manifest = json.loads(body)
    assert said.headers["Content-Type"] == manifest["mediaType"]
    assert client.ask(f"/v2/{image.name}/blobs/{manifest['config']['digest']}")[1] == image.config
    for part, content in zip(manifest["layers"], LAYERS, strict=True):
        said, body = client.ask(f"/v2/{image.name}/blobs/{part['digest']}")
        assert (said.status, len(body), sha256(body)) == (200, part["size"], part["digest"])
        assert zlib.decompress(body, 31) == content
    whole = len(image.manifest) + len(image.config) + sum(one.size for one in image.layers)
    until = time.monotonic() + 10
    while sum(sent) < whole and time.monotonic() < until:
        time.sleep(0.01)  # what was sent is counted after it was received
    assert sum(sent) == whole


def test_head_says_the_same_without_the_body(client: Client, image: ServedImage, sent: list[int]) -> None:
    for path in ("/v2/", f"/v2/{image.name}/manifests/{image.digest}", f"/v2/{image.name}/blobs/{image.image.id}"):
        asked, body = client.ask(path, "HEAD")
        got, whole = client.ask(path)
        assert (asked.status, body, asked.headers["Content-Length"]) == (200, b"", str(len(whole)))
        assert asked.headers.items() == got.headers.items()


@pytest.mark.parametrize(
    ("wanted", "first", "last"),
    [("bytes=0-9", 0, 9), ("bytes=100-", 100, -1), ("bytes=-7", -7, -1), ("bytes=5-999999999", 5, -1)],
)
def test_a_range_of_a_layer_is_given_alone(
    client: Client, image: ServedImage, wanted: str, first: int, last: int
) -> None:
    layer = image.layers[0]
    whole = layer.path.read_bytes()
    said, body = client.ask(f"/v2/{image.name}/blobs/{layer.compressed}", Range=wanted)
    start, end = first % len(whole), last % len(whole)
    assert (said.status, body) == (206, whole[start : end + 1])
    assert said.headers["Content-Range"] == f"bytes {start}-{end}/{len(whole)}"


@pytest.mark.parametrize("wanted", ["bytes=999999999-", "bytes=-0", "bytes=9-2"])
def test_a_range_past_the_end_is_refused(dial: Dial, image: ServedImage, wanted: str) -> None:
    layer = image.layers[0]
    said, _ = Client(dial()).ask(f"/v2/{image.name}/blobs/{layer.compressed}", Range=wanted)
    assert (said.status, said.headers["Content-Range"]) == (416, f"bytes */{layer.size}")


@pytest.mark.parametrize("wanted", ["bytes=0-1,4-5", "items=0-1", "bytes=-", "bytes=a-b", "bytes=" + "9" * 30 + "-"])
def test_a_range_of_another_form_is_the_whole(client: Client, image: ServedImage, wanted: str) -> None:
    layer = image.layers[0]
    said, body = client.ask(f"/v2/{image.name}/blobs/{layer.compressed}", Range=wanted)
    assert (said.status, len(body)) == (200, layer.size)


def test_whoever_does_not_know_the_name_finds_nothing(dial: Dial, image: ServedImage, sent: list[int]) -> None:
    layer = image.layers[0].compressed
    paths = [
        "/", "/v2/_catalog", f"/v2/{image.name}/tags/list", f"/v2/{image.name}/manifests/latest",
        f"/v2/{'0' * 32}/image/manifests/{image.digest}", f"/v2/{'0' * 32}/image/blobs/{layer}", f"/v2/blobs/{layer}",
        f"/v2/{image.name}/blobs/{image.image.diff_ids[0]}", f"/v2/{image.name}/manifests/../blobs/{layer}",
        f"/v2/{image.name}/referrers/{image.digest}", f"/v2/{image.name}/blobs/uploads/",
    ]  # fmt: skip
    for path in paths:
        said, body = Client(dial()).ask(path)
        assert (said.status, json.loads(body)["errors"][0]["code"]) == (404, "NOT_FOUND"), path
        assert said.headers["Connection"] == "close"
    assert sent == []
    assert image.name not in repr(image), "the name would stand in logs"
    assert served(image.image, image.config, image.layers).name != image.name


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE", "OPTIONS"])
def test_nothing_can_be_written(dial: Dial, image: ServedImage, method: str) -> None:
    said, body = Client(dial()).ask(f"/v2/{image.name}/manifests/{image.digest}", method)
    assert said.status == 501
    assert json.loads(body)["errors"][0]["code"] == "UNSUPPORTED"


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\x07" * 200, b"400"),  # TLS, without a line feed
        (b"hello\r\n\r\n", b"400"),
        (b"\0\xff\n", b"400"),
        (b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n", b"414"),
        (b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200 + b"\r\n", b"431"),
    ],
)
def test_what_is_no_request_is_answered_at_once_and_the_connection_closed(
    dial: Dial, words: bytes, status: bytes
) -> None:
    stream = dial()
    stream.sendall(words)
    said, lost = b"", False
    try:
        while piece := stream.recv(4096):
            said += piece
    except ConnectionResetError:
        lost = len(words) > 65_536  # who is closed with so much unread may lose the answer
    assert lost or said.startswith(b"HTTP/1.1 " + status + b" "), said


def test_whoever_says_nothing_or_trickles_is_not_waited_for(dial: Dial, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_STRANGER_S", 0.4)
    silent, trickling = dial(), dial()
    began = time.monotonic()
    with pytest.raises(BrokenPipeError):
        for _ in range(100):
            trickling.sendall(b"G")
            time.sleep(0.05)
    assert silent.recv(10) == b""
    assert 0.3 < time.monotonic() - began < 30


def test_a_layer_that_the_cache_has_lost_is_not_there(client: Client, image: ServedImage) -> None:
    image.layers[1].path.unlink()
    said, _ = client.ask(f"/v2/{image.name}/blobs/{image.layers[1].compressed}")
    assert said.status == 404


def test_a_layer_that_became_shorter_ends_the_connection(client: Client, image: ServedImage) -> None:
    layer = image.layers[0]
    layer.path.write_bytes(layer.path.read_bytes()[:-5])
    with pytest.raises(http.client.IncompleteRead):
        client.ask(f"/v2/{image.name}/blobs/{layer.compressed}")


def test_an_image_with_a_layer_twice_and_an_empty_blob_is_served(tmp_path: Path) -> None:
    image = an_image(tmp_path / "other", (b"", b"a", b""))
    assert [one["digest"] for one in json.loads(image.manifest)["layers"]] == [
        one.compressed for one in image.layers
    ] and len(image.layers) == 3
