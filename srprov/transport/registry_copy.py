"""An image goes to a robot's engine by a pull: from a registry that only this engine is told of, for this one image.

Takes an image as it is served and the ways to the robot; gives a reply. The image is compared where it is before it
gets its name. The loopback name under which it was pulled is taken away again.

Source: Docker Engine API 1.41, "Create an image", "Inspect an image", "Tag an image", "Remove an image".
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from msgspec.structs import replace

from srprov.layers import read_image
from srprov.session import Progress, no_progress
from srprov.transport.image_progress import Meter
from srprov.transport.image_there import Target
from srprov.transport.openssh.reverse import ForwardRefused
from srprov.transport.registry import Sent, answer
from srprov.transport.registry_image import served
from srprov.transport.ssh_session import SshSession
from srprov.transport.thin_archive import ThinArchive
from srprov.wire import EngineCall, Reply

if TYPE_CHECKING:
    from srprov.transport.engine.client import Engine
    from srprov.transport.openssh.reverse import ReverseForwards
    from srprov.transport.registry_image import ServedImage
    from srprov.transport.session import BaseSession

_FORWARD_S = 10.0


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
    client, forwards = session.engine.client, session.connection.forwards
    reply = pull_image(image, archive.tag, client, forwards, timeout_s, meter.add)
    return replace(reply, out=meter.text()) if reply.ok else reply


def pull_image(
    image: ServedImage, tag: str, engine: Engine, forwards: ReverseForwards, timeout_s: float, sent: Sent
) -> Reply:
    """Let an engine pull an image, and give it a tag once it is the one that was served.

    After a failure the tag is where it was, and nothing is left under another.

    Args:
        image: What is served.
        tag: The name that it gets.
        engine: Whose engine pulls.
        forwards: Ports of the same robot whose connections come here.
        timeout_s: How long the pull may take.
        sent: Is told the bytes that go out; by one thread at a time.

    Raises:
        NoWayBack: sshd forwards no port, or the engine does not reach it; it has asked for nothing.
        TransportError: The robot is gone.
    """
    asked, turn = threading.Event(), threading.Lock()

    def count(size: int) -> None:
        asked.set()
        with turn:
            sent(size)

    try:
        with forwards.open(lambda channel: answer(channel, image, count), _FORWARD_S) as port:
            reply = _pulled(engine, f"127.0.0.1:{port}/{image.name}", image, tag, timeout_s)
    except ForwardRefused as refused:
        raise NoWayBack(str(refused)) from refused
    if not reply.ok and not asked.is_set():
        raise NoWayBack(f"its engine does not reach the port that sshd forwards ({reply.err})")
    return reply


def _pulled(engine: Engine, repository: str, image: ServedImage, tag: str, timeout_s: float) -> Reply:
    """Pull, compare, tag; in any case leave nothing under the name that was pulled."""
    what = (("fromImage", repository), ("tag", image.digest))
    pull = EngineCall(method="POST", path="/images/create", params=what, stream=True, timeout_s=timeout_s)
    name = f"/images/{repository}@{image.digest}"
    reply = engine.call(pull, no_progress)
    if reply.ok:
        reply = _compared(engine.call(EngineCall(method="GET", path=f"{name}/json"), no_progress), image)
    if reply.ok:
        path, _, label = tag.rpartition(":")
        params = (("repo", path), ("tag", label))
        reply = engine.call(EngineCall(method="POST", path=f"{name}/tag", params=params), no_progress)
    removed = engine.call(EngineCall(method="DELETE", path=name, accept=(200, 404)), no_progress)
    return reply if removed.ok or not reply.ok else removed


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
