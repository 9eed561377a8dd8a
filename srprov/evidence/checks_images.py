"""Checks of the images in a bundle: the layout, that they are those of the run, and the lists of their packages.

Layers are unpacked piece by piece, within limits, and never written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

from srprov.definitions.lockfile import Lock, load, lock_path
from srprov.definitions.lockfile import Packages as LockedPackages
from srprov.errors import DefinitionError
from srprov.evidence.checks_files import Hashed
from srprov.evidence.files import ABOUT, Files, NotThere, Undecided, below, content, json_of
from srprov.evidence.images import LAYOUT, SBOMS, Used, sbom_name, stored, used, wanted
from srprov.evidence.make_images import listed
from srprov.evidence.story import Story
from srprov.oci import databases, sbom
from srprov.oci.layout import PackedLayer, Stored, blob
from srprov.oci.packages import as_named
from srprov.oci.packing import most_content, unpacked
from srprov.untrusted import mapping, mappings, string

_MOST_SBOM = 64 << 20
_MOST_WORK = 400_000
"""Of all images: packages, what locks say of them, and files of layers that do: each image is looked at by itself."""
_NONE = "it holds no images"


@dataclass(slots=True)
class Images:
    """The images of a bundle, each layer of which is unpacked once for all checks."""

    hashed: Hashed
    read: dict[str, databases.Layer] = field(default_factory=dict)
    """Diff id -> what of the layer says something of packages."""
    room: databases.Room = field(default_factory=databases.Room)
    _stored: tuple[Stored, ...] | None = None
    left: int = field(init=False)
    """Bytes that layers may still become: all together no more than one of their size may."""

    def __post_init__(self) -> None:
        """Count what layers there are."""
        self.left = most_content(sum(self.files.sizes[name] for name in below(self.files, LAYOUT)))

    @property
    def files(self) -> Files:
        """The bundle's files."""
        return self.hashed.files

    def stored(self) -> tuple[Stored, ...]:
        """Return the images; see `images.stored`.

        Raises:
            Undecided: The bundle holds none, and says so.
        """
        if self.way == "none" and not below(self.files, LAYOUT) and not below(self.files, SBOMS):
            raise Undecided(_NONE)
        if self._stored is None:
            self._stored = stored(self.files)
        return self._stored

    @property
    def way(self) -> str:
        """Which images the bundle says that it holds."""
        return string(mapping(json_of(self.files, ABOUT).get("images")).get("with")) or "none"

    def layer(self, one: PackedLayer) -> Iterator[str]:
        """Unpack a layer, and compare it with both of its digests."""
        if one.diff_id in self.read:
            return
        name = LAYOUT + blob(one.digest)
        if f"sha256:{self.hashed.sha256(name)}" != one.digest:
            yield f"{name} has another content than its name says"
            return
        made = sha256()

        def counted() -> Iterator[bytes]:
            for piece in unpacked(self.files.pieces(name), most_content(one.size)):
                made.update(piece)
                self.left -= len(piece)
                if self.left < 0:
                    raise ValueError("all layers together become more than any run needs")
                yield piece

        try:
            found = databases.read(counted(), self.room)
        except ValueError as error:
            yield f"{name}: {error}"
            return
        if f"sha256:{made.hexdigest()}" != one.diff_id:
            yield f"{name} becomes another layer than the configuration names"
            return
        self.read[one.diff_id] = found


def layout(images: Images) -> Iterator[str]:
    """Check the layout: what it names is there, has its size and its digests, and nothing else is there."""
    for one in images.stored():
        for layer in one.layers:
            yield from images.layer(layer)


def of_run(images: Images, story: Story) -> Iterator[str]:
    """Compare the images with those that the run's containers had, by their ids."""
    there = {id_: one for one in images.stored() for id_ in one.engine_ids}
    every = {one.id: one for one in used(story, images.files)}
    yield from (f"no container of the run had the image {id_[:80]}" for id_ in sorted(there.keys() - every.keys()))
    if there and images.way == "none":
        yield f"{ABOUT} says that there are none"
    yield from _left_out(images.files, there, [*every.values()])
    for id_, one in sorted(there.items()):
        if id_ in every and every[id_].names and {*every[id_].names} != {*one.names}:
            yield f"the image {id_[:80]} is named {', '.join(one.names)[:200]}, and was {', '.join(every[id_].names)}"


def _left_out(files: Files, there: Mapping[str, Stored], every: Sequence[Used]) -> Iterator[str]:
    """Compare what is not there with what the bundle says is not."""
    about = mapping(json_of(files, ABOUT).get("images"))
    said = {string(one.get("id")) for one in mappings(about.get("left_out"))}
    for one in every:
        if (one.id in there) == (one.id in said):
            yield f"{one.words} is {'in it, and' if one.id in there else 'not in it, nor'} said to be left out"
    for one in wanted(tuple(every), string(about.get("with"))):
        if one.id not in there:
            yield f"{one.words} should be in it"


def packages(images: Images, story: Story, strange: str) -> Iterator[str]:
    """List the packages of each image again from its layers, and compare the lists, and what locks recorded.

    Raises:
        Undecided: The lists differ, and `strange` says why another srprov may have made them otherwise.
    """
    every, locks, work = images.stored(), _locks(story), 0
    for one in every:
        if any(layer.diff_id not in images.read for layer in one.layers):
            yield f"the packages of {one.id} cannot be listed, as its layers are wrong"
            continue
        layers = {layer.diff_id: images.read[layer.diff_id] for layer in one.layers}
        said = [each for name in dict.fromkeys(one.names) for each in locks.get(name, ())]
        work += sum(layer.work for layer in layers.values()) + sum(record.count for _, record in said)
        if work > _MOST_WORK:
            yield "its images have longer lists of packages than any run needs"
            return
        try:
            follows = listed(one, [images.read[layer.diff_id] for layer in one.layers])
        except ValueError as error:
            yield f"the packages of {one.id} cannot be listed: {error}"
            continue
        work += len(follows.packages)
        there = content(images.files, sbom_name(one.id), _MOST_SBOM)
        if there != sbom.text(follows).encode("utf-8", "replace"):
            if strange:
                raise Undecided(strange)
            yield f"{sbom_name(one.id)} is not what follows from the image's layers"
        yield from _recorded(one, follows, said)
    known = {sbom_name(one.id) for one in every}
    yield from (f"{name} is of no image in the bundle" for name in below(images.files, SBOMS) if name not in known)


def _locks(story: Story) -> dict[str, list[tuple[str, LockedPackages]]]:
    """Return name of an image -> what locks say of it, with their sessions; each lock is read once, for all images."""
    first = {one.definitions.experiment.file: one.home for one in reversed(story.sessions)}
    found: dict[str, list[tuple[str, LockedPackages]]] = {}
    for edf, home in sorted(first.items()):
        for record in locked(edf).packages:
            found.setdefault(record.image, []).append((home, record))
    return found


def _recorded(
    one: Stored, follows: sbom.Sbom, said: Iterable[tuple[str, LockedPackages]]
) -> Iterator[str]:  # fmt: skip
    """Compare an image with the packages that locks say it ended with beyond its base."""
    there = {as_named(package) for package in follows.packages}
    if follows.unread:  # it may have more
        return
    platform = "/".join(one.platform[key] for key in ("os", "architecture", "variant") if key in one.platform)
    for home, record in said:
        if record.platform == platform and (missing := sorted({*record.apt, *record.pip, *record.npm} - there)):
            yield f"{home}: the lock says that {record.image} has {', '.join(missing)[:300]}"


def locked(edf: str) -> Lock:
    """Return the lock beside an EDF; an empty one where there is none.

    Raises:
        NotThere: It cannot be read.
    """
    try:
        return load(lock_path(edf)) or Lock()
    except DefinitionError as error:
        raise NotThere(f"the lock cannot be read: {error.problems[0].message}") from None
