"""The images of a run into its bundle: an OCI layout, and a list of the packages of each.

Takes images as an engine gives them, each layer as its tar; writes blobs one after the other through a file beside the
bundle, so that one piece is in memory at a time. Equal images give equal files.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol

import msgspec
from msgspec.structs import replace

from srprov.evidence import story
from srprov.evidence.files import Files
from srprov.evidence.images import LAYOUT, Used, sbom_name, used, wanted
from srprov.evidence.secrets import OVERLAP
from srprov.layers import read_config
from srprov.oci import databases, packages, sbom
from srprov.oci.layout import PackedLayer, Stored, blob, documents, leading, sha256, word
from srprov.oci.packing import Packer, most_content
from srprov.secret import holds
from srprov.untrusted import json_or_none, mapping

if TYPE_CHECKING:
    from srprov.controller.bundle_images import Read
    from srprov.transport.blob import Blob

_MARGIN = 64 << 20
_PIECE = 1 << 20
Say = Callable[[str], None]


class Giver(Protocol):
    """Whoever has images."""

    def read(self, image: str, words: str, first: Sequence[str], say: Say, names: Collection[str]) -> Read:
        """Bring an image here; see `controller.bundle_images.Engines`."""


class GivenImage(msgspec.Struct, frozen=True):
    """An image that is here."""

    used: Used
    read: Read


Add = Callable[[str, int, str, Iterable[bytes]], None]
"""Adds a file to the bundle: its name, its bytes, their sha256 in hex, its content."""


def check_room(images: Iterable[GivenImage], more: int, folder: Path) -> None:
    """Look whether there is room for all of a bundle, before anything of it is written.

    Raises:
        OSError: There is not.
    """
    layers = {one.digest: one.size for image in images for one in image.read.layers}
    need = sum(layers.values()) + max(layers.values(), default=0) + more + _MARGIN
    free = shutil.disk_usage(folder).free
    if free < need:
        why = f"there is no room: {need >> 20} MiB are needed, {free >> 20} MiB are free"
        raise OSError(errno.ENOSPC, why, str(folder))


class Wish(msgspec.Struct, frozen=True, kw_only=True):
    """Which images a bundle is to hold, and who has them."""

    way: str
    """`ours` or `all`"""
    giver: Giver
    say: Say


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a wish."""

    folder: Path
    """Where a layer may lie as long as it is being packed."""
    images: Sequence[GivenImage] = ()
    say: Say = lambda _text: None
    about: Mapping[str, object] = msgspec.field(default_factory=lambda: {"with": "none"})
    """What `bundle.json` says of it."""


def found(wish: Wish | None, files: Files, folder: Path) -> Found:
    """Bring the images of a run here.

    Raises:
        ValueError: The run cannot be read.
        UsageError, OSError: As `Giver.read` and `check_room` say.
    """
    if wish is None:
        return Found(folder=folder)
    with story.read(files) as told:
        every = used(told, files)
    mine = wanted(every, wish.way)
    images = [GivenImage(one, wish.giver.read(one.id, one.words, one.robots, wish.say, one.names)) for one in mine]
    check_room(images, sum(files.sizes.values()), folder)
    left = [{"id": one.id, "names": list(one.names)} for one in every if one not in mine]
    return Found(folder=folder, images=images, say=wish.say, about={"with": wish.way, "left_out": left})


@dataclass(slots=True)
class Packing:
    """Images on their way into a bundle."""

    add: Add
    found: Found
    done: dict[str, PackedLayer] = field(default_factory=dict)
    read: dict[str, databases.Layer] = field(default_factory=dict)
    """Diff id -> what of the layer says something of packages."""
    room: databases.Room = field(default_factory=databases.Room)
    secret: dict[str, str] = field(default_factory=dict)
    """File of the bundle -> what is wrong with it: a layer holds the value of a secret."""

    def all(self) -> dict[str, bytes]:
        """Add all layers; return path -> content of what else belongs into the bundle.

        Raises:
            ValueError: An image is none.
            OSError: Something cannot be read or written.
        """
        every: dict[str, Stored] = {}
        texts: dict[str, bytes] = {}
        for one in self.found.images:
            found = self._image(one)
            before = every.get(found.id)  # engines with stores of two kinds know one image by two ids
            every[found.id] = _together(before, found) if before else found
        for image in every.values():
            text = sbom.text(listed(image, [self.read[layer.diff_id] for layer in image.layers]))
            texts[sbom_name(image.id)] = text.encode("utf-8", "replace")
        if every:
            texts |= {f"{LAYOUT}{path}": content for path, content in documents([*every.values()]).items()}
        return {path: texts[path] for path in sorted(texts)}

    def _image(self, given: GivenImage) -> Stored:
        config = given.read.config
        said = mapping(json_or_none(config.decode("utf-8", "replace")))
        id_ = sha256(config)
        image = read_config(id_, said)
        if image is None:
            raise ValueError(f"{given.used.words} has no configuration")
        for number, layer in enumerate(given.read.layers, start=1):
            if layer.digest not in self.done:
                self.found.say(f"packing {given.used.words}, layer {number} of {len(given.read.layers)}")
                self._layer(layer, given.used)
        known = {sha256(one): one for one in given.read.documents}
        return Stored(
            id=id_, engine_ids=(given.used.id,), names=given.used.names or (f"srprov/image:{id_[7:19]}",),
            config=config, layers=tuple(self.done[one] for one in image.diff_ids),
            documents=leading([given.used.id], id_, known.get), architecture=image.architecture,
            os=word(said.get("os")), variant=word(said.get("variant")),
        )  # fmt: skip

    def _layer(self, layer: Blob, used: Used) -> None:
        """Pack a layer into a file, and add that."""
        with tempfile.TemporaryFile(dir=self.found.folder, prefix=".srprov-") as stream:
            packer = Packer()
            self.read[layer.digest] = databases.read(self._packed(layer, used, packer, stream), self.room)
            stream.write(packer.finish())
            if packer.content_digest != layer.digest:
                raise ValueError(f"a layer of {used.words} is not what its digest says")
            if packer.content_size > most_content(packer.size):
                raise ValueError(f"a layer of {used.words} is nearly empty, and has {packer.content_size >> 20} MiB")
            self.done[layer.digest] = PackedLayer(layer.digest, packer.digest, packer.size)
            name = LAYOUT + blob(packer.digest)
            if layer.digest in self.secret:
                self.secret[name] = self.secret.pop(layer.digest)
            self.add(name, packer.size, packer.digest.removeprefix("sha256:"), _from(stream))

    def _packed(self, layer: Blob, used: Used, packer: Packer, stream: BinaryIO) -> Iterator[bytes]:
        """Pass a layer on while it is packed and looked through for secrets."""
        before, told = b"", False
        for piece in layer.content():
            if not told and holds(before + piece):
                told = True
                self.secret[layer.digest] = f"the value of a secret, in a layer of {used.words}"
            before = piece[-OVERLAP:]
            stream.write(packer.add(piece))
            yield piece


def _together(one: Stored, other: Stored) -> Stored:
    both = {sha256(data): data for data in (*one.documents, *other.documents)}
    return replace(
        one, engine_ids=tuple(sorted({*one.engine_ids, *other.engine_ids})),
        names=tuple(sorted({*one.names, *other.names})), documents=tuple(both[digest] for digest in sorted(both)),
    )  # fmt: skip


def listed(one: Stored, layers: Sequence[databases.Layer]) -> sbom.Sbom:
    """Return the packages of an image.

    Raises:
        ValueError: There are too many.
    """
    files = databases.merged(layers)
    return sbom.Sbom(
        image=one.id, name=one.names[0], architecture=one.architecture, system=packages.system(files),
        packages=packages.packages(files),
        unread=tuple(f"{each.diff_id}: {read.unread}" for each, read in zip(one.layers, layers, strict=True)
                     if read.unread),
    )  # fmt: skip


def _from(stream: BinaryIO) -> Iterator[bytes]:
    stream.seek(0)
    while piece := stream.read(_PIECE):
        yield piece
