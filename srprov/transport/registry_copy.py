"""An image goes to a robot's engine by a pull: from a registry that only this engine is told of, for this one image.

Takes an image as it is served and the ways to the robot; gives a reply. The image is compared where it is before it
gets its name. The loopback name under which it was pulled is taken away again.

Source: Docker Engine API 1.41, "Create an image", "Inspect an image", "Tag an image", "Remove an image",
"Import images".
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from msgspec.structs import replace

from srprov.layers import read_image
from srprov.session import Progress, no_progress
from srprov.transport.image_progress import Meter
from srprov.transport.image_there import Room, Target
from srprov.transport.oci_archive import layers_but, loaded
from srprov.transport.openssh.reverse import ForwardRefused
from srprov.transport.registry import answer
from srprov.transport.registry_image import served
from srprov.transport.ssh_session import SshSession
from srprov.transport.thin_archive import ThinArchive
from srprov.untrusted import mapping, mappings, strings
from srprov.wire import EngineCall, Reply

if TYPE_CHECKING:
    from srprov.transport.engine.client import Engine
    from srprov.transport.openssh.reverse import ReverseForwards
    from srprov.transport.registry_image import ServedImage
    from srprov.transport.session import BaseSession

_FORWARD_S = 10.0
_MOST_IMAGES = 5000


class NoWayBack(Exception):
    """The engine cannot come here; the text says why."""


def copy_by_registry(
    archive: ThinArchive, target: Target, session: BaseSession, timeout_s: float, progress: Progress
) -> Reply:
    """Let a robot's engine pull an image of which all layers are in the cache; it takes those that it lacks.

    Raises:
        NoWayBack: The engine cannot come here; it has asked for nothing.
        TransportError: The robot is gone.
        OSError: The cache's files are gone.
    """
    if not isinstance(session, SshSession):
        raise NoWayBack("this machine forwards no port to itself")
    # a classic store looks for what it has pulled before, and may take what it has got otherwise once more
    missing = archive.image.diff_ids if target.classic else target.missing(archive.image)
    lacks = [one for one in archive.layers if one.digest in missing]
    size, unpacked = sum(one.size for one in lacks), sum(one.content_size for one in lacks)
    if lack := target.room.lack(size, unpacked, spooled=False):
        return Reply(status=0, ok=False, err=lack)
    blobs = {one.digest: one for one in archive.layers}
    image = served(archive.image, b"".join(archive.config.content()), [blobs[one] for one in archive.image.diff_ids])
    meter = Meter(f"{archive.tag}, through a registry", progress, size)
    pull = Pull(image, archive.tag, session.engine.client, timeout_s, meter, target.room)
    reply = pull.run(session.connection.forwards)
    return replace(reply, out=meter.text()) if reply.ok else reply


class Pull:
    """One pull of an image by an engine."""

    def __init__(
        self, image: ServedImage, tag: str, engine: Engine, timeout_s: float, meter: Meter, room: Room
    ) -> None:
        """Take what is pulled.

        Args:
            image: What is served.
            tag: The name that it gets once it is the one that was served.
            engine: Whose engine pulls.
            timeout_s: How long the pull may take.
            meter: Counts the bytes that go out.
            room: What is free on the robot.
        """
        self._image, self._tag, self._engine, self._timeout_s = image, tag, engine, timeout_s
        self._meter, self._room = meter, room
        self._asked, self._turn, self._given = threading.Event(), threading.Lock(), set[str]()

    def run(self, forwards: ReverseForwards) -> Reply:
        """Do it; after a failure the tag is where it was, and nothing is left under another.

        Args:
            forwards: Ports of the same robot whose connections come here.

        Raises:
            NoWayBack: sshd forwards no port, or the engine does not reach it; it has asked for nothing.
            TransportError: The robot is gone.
            OSError: The cache's files are gone.
        """
        try:
            with forwards.open(lambda channel: answer(channel, self._image, self._count), _FORWARD_S) as port:
                reply = self._pulled(f"127.0.0.1:{port}/{self._image.name}")
        except ForwardRefused as refused:
            raise NoWayBack(str(refused)) from refused
        if not reply.ok and not self._asked.is_set():
            raise NoWayBack(f"its engine does not reach the port that sshd forwards ({reply.err})")
        return reply

    def _count(self, digest: str, size: int) -> None:
        self._asked.set()
        with self._turn:
            self._meter.add(size)
            if size:
                self._given.add(digest)

    def _pulled(self, repository: str) -> Reply:
        """Pull, compare, tag; in any case leave nothing under the name that was pulled."""
        what = (("fromImage", repository), ("tag", self._image.digest))
        name = f"{repository}@{self._image.digest}"
        timeout_s = self._timeout_s
        create = EngineCall(method="POST", path="/images/create", params=what, stream=True, timeout_s=timeout_s)
        reply = self._engine.call(create, no_progress)
        try:
            if reply.ok:
                reply = self._completed(name)
            if reply.ok:
                path, _, label = self._tag.rpartition(":")
                tag = EngineCall(method="POST", path=f"/images/{name}/tag", params=(("repo", path), ("tag", label)))
                reply = self._engine.call(tag, no_progress)
        finally:
            removal = EngineCall(method="DELETE", path=f"/images/{name}", accept=(200, 404))
            removed = self._engine.call(removal, no_progress)
        return reply if removed.ok or not reply.ok else removed

    def _completed(self, name: str) -> Reply:
        """Return what the engine says of the image if it is the one that was served, else why not.

        What it has left out is loaded.
        """
        look = EngineCall(method="GET", path=f"/images/{name}/json")
        reply = self._engine.call(look, no_progress)
        layers = layers_but(self._image, self._given)
        if not layers or self._is_whole(mapping(reply.json()) if reply.ok else {}):
            return _compared(reply, self._image)
        size = sum(one.size for one in layers)
        if lack := self._room.lack(size, 0, spooled=False):
            return Reply(status=0, ok=False, err=lack)
        self._meter.grow(size)
        pieces = self._meter.count(loaded(self._image, name, layers))
        reply = self._engine.load(pieces, self._timeout_s, no_progress)
        return _compared(self._engine.call(look, no_progress), self._image) if reply.ok else reply

    def _is_whole(self, said: Mapping[str, Any]) -> bool:
        """Return whether the engine shows an image with layers, and lists it; Docker 28 lacks the one, 26 the other."""
        if not strings(mapping(said.get("RootFS")).get("Layers")):
            return False
        listed = self._engine.call(EngineCall(method="GET", path="/images/json"), no_progress)
        return any(one.get("Id") == said.get("Id") for one in mappings(listed.json(), most=_MOST_IMAGES))


def _compared(inspected: Reply, image: ServedImage) -> Reply:
    """Return the reply when the image that is there is the one that was served; else why not.

    A classic store knows an image by its configuration, a containerd store by its manifest, which names that.
    """
    if not inspected.ok:
        return inspected
    there = read_image(inspected.json())
    if there is None or there.diff_ids != image.image.diff_ids or there.id not in (image.image.id, image.digest):
        return Reply(status=0, ok=False, err="what the engine pulled is not the image that was served")
    return inspected
