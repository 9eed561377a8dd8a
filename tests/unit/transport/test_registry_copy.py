"""What is asked of an engine that pulls, and what is believed of it."""

from __future__ import annotations

import contextlib
import io
import json
import socket
import tarfile
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from srprov.session import Progress, no_progress
from srprov.transport.image_progress import Meter
from srprov.transport.image_there import Room
from srprov.transport.openssh.reverse import ForwardRefused
from srprov.transport.registry_copy import NoWayBack, Pull
from srprov.transport.registry_image import ServedImage
from srprov.wire import EngineCall, Reply

from .test_registry import an_image

TAG = "srprov/talker:0123456789abcdef"


class Forwards:
    """Gives the function that answers to whoever pulls."""

    def __init__(self, refused: str = "") -> None:
        self.refused, self.open_now = refused, 0
        self.answer: Callable[[socket.socket], None] | None = None

    @contextlib.contextmanager
    def open(self, answer: Callable[[Any], None], _seconds: float) -> Iterator[int]:
        if self.refused:
            raise ForwardRefused(self.refused)
        self.answer, self.open_now = answer, self.open_now + 1
        try:
            yield 40_000
        finally:
            self.open_now -= 1


@dataclass
class Engine:
    """An engine that says what it is told to say."""

    image: ServedImage
    forwards: Forwards
    pulls: bool = True
    reaches: bool = True
    says: dict[str, Any] = field(default_factory=dict)
    """In the place of what it should say of the image."""
    unpacked: Collection[str] = ()
    """Compressed layers of which it has the content: it asks for none of these, and shows no image without them."""
    has: Collection[str] = ()
    """Compressed layers that it has just so."""
    lists: bool = True
    """It lists such an image, and shows it without layers, as Docker 28 does; else it is the other way round."""
    takes: bool = True
    """It has what it is given to load."""
    room: Room = field(default_factory=Room)
    loaded: list[tarfile.TarInfo] = field(default_factory=list)
    tags: bool = True
    removes: int = 200
    calls: list[str] = field(default_factory=list)

    def call(self, call: EngineCall, _progress: Progress) -> Reply:
        self.calls.append(call.text())
        assert self.forwards.open_now == 1
        if call.path == "/images/create":
            if self.reaches:
                self._ask()
            ok = self.pulls and self.reaches
            return Reply(status=200, ok=ok, err="" if ok else "filesystem layer verification failed")
        if call.path == "/images/json":
            return Reply(
                status=200, out=json.dumps([{"Id": self.image.image.id}] if self.lists or not self.unpacked else [])
            )
        if call.method == "GET":
            if self.unpacked and self.lists:
                return Reply(status=200, out=json.dumps({"Id": self.image.digest, "RootFS": {}}))
            said = {"Id": self.image.image.id, "RootFS": {"Layers": list(self.image.image.diff_ids)}, **self.says}
            return Reply(status=200, out=json.dumps(said))
        if call.method == "POST":
            return Reply(status=201) if self.tags else Reply(status=500, ok=False, err="cannot tag")
        return Reply(status=self.removes, ok=self.removes in call.accept, err="conflict")

    def load(self, pieces: Iterator[bytes], _timeout_s: float, _progress: Progress) -> Reply:
        self.calls.append("load")
        with tarfile.open(fileobj=io.BytesIO(b"".join(pieces))) as archive:
            self.loaded = archive.getmembers()
        if self.takes:
            self.unpacked = ()
        return Reply(status=200)

    def _ask(self) -> None:
        for one in self.image.layers:
            if one.compressed not in (*self.unpacked, *self.has):
                self._get(f"blobs/{one.compressed}")
        self._get(f"manifests/{self.image.digest}")

    def _get(self, path: str) -> None:
        here, there = socket.socketpair()
        with here, there:
            here.sendall(f"GET /v2/{self.image.name}/{path} HTTP/1.1\r\nRange: bytes=0-9\r\n\r\n".encode())
            here.shutdown(socket.SHUT_WR)
            assert self.forwards.answer is not None
            self.forwards.answer(there)
            assert here.recv(1 << 16).startswith(b"HTTP/1.1 206 ")


@pytest.fixture
def image(tmp_path: Path) -> ServedImage:
    return an_image(tmp_path / "blobs")


@pytest.fixture
def engine(image: ServedImage) -> Engine:
    return Engine(image, Forwards())


def pull(engine: Engine) -> Reply:
    meter = Meter("it", no_progress)
    return Pull(engine.image, TAG, engine, 30.0, meter, engine.room).run(engine.forwards)  # type: ignore[arg-type]


def words(engine: Engine) -> list[str]:
    """Return the calls without what is different each time."""
    return [one.replace(engine.image.name, "NAME").replace(engine.image.digest, "DIGEST") for one in engine.calls]


PULL = "POST /images/create?fromImage=127.0.0.1:40000/NAME&tag=DIGEST"
LOOK = "GET /images/127.0.0.1:40000/NAME@DIGEST/json"
LIST = "GET /images/json"
NAME = "POST /images/127.0.0.1:40000/NAME@DIGEST/tag?repo=srprov/talker&tag=0123456789abcdef"
FORGET = "DELETE /images/127.0.0.1:40000/NAME@DIGEST"


def test_it_is_pulled_by_digest_compared_named_and_its_loopback_name_removed(engine: Engine) -> None:
    assert pull(engine).ok
    assert words(engine) == [PULL, LOOK, NAME, FORGET]
    assert engine.forwards.open_now == 0


def test_a_containerd_store_knows_it_by_its_manifest(engine: Engine, image: ServedImage) -> None:
    engine.says = {"Id": image.digest}
    assert pull(engine).ok
    assert words(engine)[2:] == [NAME, FORGET]


@pytest.mark.parametrize(
    "says",
    [
        {"Id": "sha256:" + "0" * 64},
        {"Id": ""},
        {"Id": ["sha256:" + "0" * 64]},
        {"RootFS": None},
        {"RootFS": {"Layers": []}},
        {"RootFS": {"Layers": ["sha256:" + "1" * 64, "sha256:" + "2" * 64]}},
    ],
)
def test_another_image_than_was_served_gets_no_name(engine: Engine, says: dict[str, Any]) -> None:
    engine.says = says
    reply = pull(engine)
    assert not reply.ok and "not the image that was served" in reply.err
    assert words(engine) == [PULL, LOOK, FORGET]


@pytest.mark.parametrize("lists", [True, False])
def test_a_layer_that_the_engine_did_not_ask_for_is_loaded(engine: Engine, image: ServedImage, lists: bool) -> None:
    """It has the content from another registry, compressed otherwise; without this the image is half there."""
    base, top = image.layers
    engine.unpacked, engine.lists = {base.compressed}, lists
    assert pull(engine).ok
    assert words(engine) == [PULL, LOOK, *([] if lists else [LIST]), "load", LOOK, NAME, FORGET]
    blobs = [image.digest, image.image.id, base.compressed]
    names = ["oci-layout", "index.json", *(f"blobs/{one.replace(':', '/')}" for one in blobs)]
    assert [one.name for one in engine.loaded] == names and top.compressed not in str(names)


def test_what_it_has_as_it_is_served_is_not_loaded(engine: Engine, image: ServedImage) -> None:
    """It did not ask for it as it has it from an earlier copy."""
    engine.has = {image.layers[0].compressed}
    assert pull(engine).ok
    assert words(engine) == [PULL, LOOK, LIST, NAME, FORGET]


def test_what_is_not_there_after_that_either_gets_no_name(engine: Engine, image: ServedImage) -> None:
    engine.unpacked, engine.takes = {image.layers[0].compressed}, False
    assert "not the image that was served" in pull(engine).err
    assert words(engine) == [PULL, LOOK, "load", LOOK, FORGET]


def test_what_is_loaded_must_find_room(engine: Engine, image: ServedImage) -> None:
    engine.unpacked, engine.room = {image.layers[0].compressed}, Room(engine=1)
    assert "its Docker's disk is too small" in pull(engine).err
    assert words(engine) == [PULL, LOOK, FORGET]


def test_after_a_failed_pull_nothing_is_named(engine: Engine) -> None:
    engine.pulls = False
    reply = pull(engine)
    assert (reply.ok, reply.err) == (False, "filesystem layer verification failed")
    assert words(engine) == [PULL, FORGET]


def test_a_name_that_cannot_be_given_or_taken_away_is_a_failure(engine: Engine) -> None:
    engine.tags = False
    assert pull(engine).err == "cannot tag"
    engine.tags, engine.removes = True, 409
    assert not pull(engine).ok


def test_an_engine_that_never_came_is_told_from_one_that_failed(engine: Engine) -> None:
    engine.reaches = False
    with pytest.raises(NoWayBack, match="does not reach the port"):
        pull(engine)
    engine.forwards.refused = "sshd forwards no port"
    engine.calls.clear()
    with pytest.raises(NoWayBack, match="sshd forwards no port"):
        pull(engine)
    assert engine.calls == []
