"""Which images the trials of a run had, and those that a bundle holds. Pure, but for the files that are read.

`images/` of a bundle is an OCI layout, `sbom/` has a list of packages for each image of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import msgspec

from srprov.evidence.files import Files, NotThere, below, content, json_of
from srprov.evidence.story import Story, attempt_folder
from srprov.image_reference import BUILT, BUNDLED
from srprov.oci.layout import LONGEST, Stored
from srprov.oci.layout_read import Source
from srprov.oci.layout_read import read as read_layout
from srprov.trials.judge import COUNTED
from srprov.untrusted import mapping, string, string_map

LAYOUT, SBOMS = "images/", "sbom/"
WAYS = ("none", "ours", "all")
_ID = re.compile("sha256:[0-9a-f]{64}")
NAME = re.compile("[A-Za-z0-9][A-Za-z0-9@:/._-]{0,400}")
_IMAGE, _IMAGE_ID, _ROBOT = ": image", ": image id", ": robot"


class Used(msgspec.Struct, frozen=True, kw_only=True):
    """An image that containers of a run had."""

    id: str
    """As the engine of their robot named it."""
    names: tuple[str, ...] = ()
    """As the experiment names it; empty where nothing says it."""
    services: tuple[str, ...] = ()
    robots: tuple[str, ...] = ()

    @property
    def built(self) -> bool:
        """Whether srprov built it; of an image that came from a bundle nobody knows."""
        return any(one.startswith(BUILT) and not one.startswith(BUNDLED) for one in self.names)

    @property
    def words(self) -> str:
        """It, in words."""
        return f"{', '.join(self.names) or 'an image'} ({self.id.removeprefix('sha256:')[:12]})"


@dataclass(slots=True)
class _Found:
    names: set[str] = field(default_factory=set)
    services: set[str] = field(default_factory=set)
    robots: set[str] = field(default_factory=set)


def used(story: Story, files: Files) -> tuple[Used, ...]:
    """Return the images of all segments of a run, by their ids.

    Raises:
        NotThere: What an engine said of the containers of an attempt that counts cannot be read.
    """
    found: dict[str, _Found] = {}
    stated = [string_map(one["same"]) for one in story.events if one["event"] in ("run", "resume", "accept")
              and "same" in one]  # fmt: skip
    names: dict[str, set[str]] = {}
    for same in stated:
        for key, name in same.items():
            service = key.removesuffix(_IMAGE)
            if key.endswith(_IMAGE) and NAME.fullmatch(name):
                names.setdefault(service, set()).add(name)
                if _ID.fullmatch(id_ := same.get(f"{service}{_IMAGE_ID}", "")):
                    one = found.setdefault(id_, _Found())
                    one.names.add(name)
                    one.services.add(service)
                    one.robots.add(same.get(f"{service}{_ROBOT}", ""))
    for service, id_ in _of_containers(story, files):
        one = found.setdefault(id_, _Found())
        one.services.add(service)
        if not one.names and len(names.get(service, ())) == 1:
            one.names |= names[service]
    return tuple(
        Used(id=id_, names=tuple(sorted(one.names)), services=tuple(sorted(one.services)),
             robots=tuple(sorted(one.robots - {""})))
        for id_, one in sorted(found.items())
    )  # fmt: skip


def _of_containers(story: Story, files: Files) -> Iterator[tuple[str, str]]:
    for row in story.ended:
        name = f"{attempt_folder(row)}/containers.json"
        if row.get("status") in COUNTED and name in files.sizes:
            for service, one in json_of(files, name).items():
                if _ID.fullmatch(id_ := string(mapping(one).get("Image"))):
                    yield service, id_


def wanted(every: tuple[Used, ...], way: str) -> tuple[Used, ...]:
    """Return the images that a bundle is to hold: `none`, `ours` (those that srprov built), or `all`."""
    return tuple(one for one in every if way == "all" or (way == "ours" and one.built))


def sbom_name(image: str) -> str:
    """Return where a bundle has the list of packages of an image, which is named by its configuration's digest."""
    return f"{SBOMS}{image.removeprefix('sha256:')}.cdx.json"


def has_images(files: Files | Mapping[str, object]) -> bool:
    """Return whether a bundle holds images."""
    names = files if isinstance(files, Mapping) else files.sizes
    return any(one.startswith(LAYOUT) for one in names)


def stored(files: Files) -> tuple[Stored, ...]:
    """Return the images of a bundle; none where it has no layout.

    Raises:
        NotThere: The layout is not one that srprov wrote.
    """
    names = below(files, LAYOUT)
    if not names:
        return ()
    sizes = {one.removeprefix(LAYOUT): files.sizes[one] for one in names}
    try:
        return read_layout(Source(sizes, lambda path: content(files, LAYOUT + path, LONGEST)))
    except NotThere:
        raise
    except ValueError as error:
        raise NotThere(f"{LAYOUT}: {error}") from None
