"""What a robot's engine has: its store, an image's layers, the layers of all its images, and room for more."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from srprov.layers import Image, has_classic_store, has_containerd_store, missing_layers, read_image
from srprov.session import Reader
from srprov.untrusted import folder, integer, lines_of, mapping, mappings, string
from srprov.wire import AnyQuery, EngineQuery, Query, Reply, quote

_MOST_IMAGES = 500
INFO = EngineQuery(path="/info")
FIRST = (INFO, EngineQuery(path="/images/json"))
"""What a robot is asked that is to get an image; then `second_look`."""
_MARGIN = 64 << 20
_STATE = "/var/lib/srprov"


class Room(msgspec.Struct, frozen=True):
    """Free bytes where an engine unpacks what it loads, and where a spool would be."""

    engine: int | None = None
    spool: int | None = None
    shared: bool = True
    """Both are on one filesystem."""

    def lack(self, archive: int, unpacked: int, *, spooled: bool, have: int = 0) -> str:
        """Say what is too small for an archive and what it becomes, with both sizes; nothing if all fits.

        The engine keeps the archive beside what it unpacks until it is done; of the spool's, `have` bytes are there.
        """
        spool = archive - have
        engine = archive + unpacked + _MARGIN + (spool if spooled and self.shared else 0)
        if self.engine is not None and engine > self.engine:
            return _lack("its Docker's disk", engine, self.engine)
        if spooled and not self.shared and self.spool is not None and spool + _MARGIN > self.spool:
            return _lack(f"the disk of {_STATE}", spool + _MARGIN, self.spool)
        return ""


def _lack(what: str, needed: int, free: int) -> str:
    return f"{what} is too small: {-(-needed // (1 << 20))} MiB are needed, {free >> 20} MiB are free"


class Target(msgspec.Struct, frozen=True):
    """A robot that is to get an image."""

    classic: bool
    images: tuple[Image, ...]
    room: Room
    containerd: bool = False

    def missing(self, image: Image) -> tuple[str, ...]:
        """Return the layers that it lacks, each once."""
        return tuple(dict.fromkeys(missing_layers(image, self.images)))


def image_of(reader: Reader, name: str) -> Image | None:
    """Return the image that an engine has under a name.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    (reply,) = reader.ask([EngineQuery(path=f"/images/{name}/json")])
    return read_image(reply.json()) if reply.ok else None


def store_of(reader: Reader) -> str:
    """Return `classic` or `containerd`, or nothing for an engine that tells neither; raises as `image_of` does."""
    info = reader.ask([INFO])[0].json()
    return "classic" if has_classic_store(info) else "containerd" if has_containerd_store(info) else ""


def look_at(reader: Reader) -> Target:
    """Return what a robot has; two round trips. Raises as `image_of` does."""
    first = reader.ask(FIRST)
    return read_target(first, reader.ask(second_look(first)))


def second_look(first: Sequence[Reply]) -> list[AnyQuery]:
    """Return what to ask a robot that was asked `FIRST`."""
    info, listed = (reply.json() for reply in first)
    root = folder(mapping(info).get("DockerRootDir")) or "/var/lib/docker"
    ids = dict.fromkeys(string(one.get("Id")) for one in mappings(listed, most=_MOST_IMAGES))
    inspected = [EngineQuery(path=f"/images/{image}/json") for image in ids if image.startswith("sha256:")]
    return [Query(command=_free(root)), *inspected]


def read_target(first: Sequence[Reply], second: Sequence[Reply]) -> Target:
    """Return what a robot answered to `FIRST` and to `second_look`."""
    found = [image for reply in second[1:] if reply.ok and (image := read_image(reply.json()))]
    info = first[0].json()
    return Target(has_classic_store(info), tuple(found), _room(second[0].out), has_containerd_store(info))


def _free(root: str) -> str:
    return f"df -Pk {quote(root)} 2>/dev/null | tail -n 1; d={_STATE}; [ -d $d ] || d=/var/lib; df -Pk $d | tail -n 1"


def _room(out: str) -> Room:
    lines = [line.split() for line in lines_of(out, 2)]
    if len(lines) != 2 or min(map(len, lines)) < 6:
        return Room()
    engine, spool = (integer(one[3]) * 1024 for one in lines)
    return Room(engine, spool, lines[0][0] == lines[1][0])
