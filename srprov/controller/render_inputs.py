"""What the contexts of playbooks are made of: the values of every room side by side. Values only."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import msgspec

from srprov.controller.data_plan import DataPlan
from srprov.controller.request import BundledImage
from srprov.definitions.model import Experiment
from srprov.facts.model import Snapshot
from srprov.network.model import Overlay

if TYPE_CHECKING:
    from srprov.images.plan import ImagePlan


class RenderInputs(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that contexts are made of."""

    instance: str
    source: str
    experiment: Experiment
    placed: Mapping[str, str]
    overlay: Overlay
    images: Mapping[str, ImagePlan]
    """CDF key -> what is built for it; only for CDFs that need a build."""
    references: Mapping[str, str]
    """CDF key -> ready image, for CDFs that name one."""
    record: Mapping[str, Any]
    """The placement record that every robot gets."""
    snapshot: Snapshot
    data: DataPlan
    copy_way: str = ""
    """How the user wants images copied: `thin`, `whole`, or as it is possible."""
    copied: Mapping[tuple[str, str], Mapping[str, Any]] = msgspec.field(default_factory=dict)
    """(robot, image) -> `way` and `missing` of a copy, where that is known."""
    known_images: Mapping[str, Collection[str]] = msgspec.field(default_factory=dict)
    """What `built_for` says of a content tag -> ids of images that this machine had built; a robot's own word for a tag
    is not enough."""
    images_only: bool = False
    """Nothing but images is wanted on robots."""
    images_for: Collection[str] = ()
    """Only those of these services, then; empty: of all."""
    bundled: Mapping[str, BundledImage] = msgspec.field(default_factory=dict)
    """Service -> the image that it has from this machine's cache of layers."""
    builders: Collection[str] = ()
    """The hosts of the inventory's group `builders`: images are built there first."""
    doubts: tuple[str, ...] = ()
    """Notes on what one robot alone says of images that others get, too."""
