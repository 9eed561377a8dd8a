"""Images as engines with classic stores know them: which layers one has, and which of them another robot lacks. Pure.

A store finds a layer by its *chain id*, made of the diff ids (sha256 of the uncompressed tar) of that layer and of all
below it. So the same layer on another base is missing, and one whose chain is there comes with all below it, however
it got there: by build, load or pull.

Source: OCI Image Format Specification, "Layer ChainID"; moby's `image/tarexport/load.go`.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from srprov.untrusted import integer, mapping, string

MANIFEST = "manifest.json"
_DIGEST = re.compile("sha256:[0-9a-f]{64}")
_ARCHITECTURE = re.compile("[a-z0-9_-]{1,20}")
_MOST_LAYERS = 512
"""An engine takes 127."""
_EMPTY = "sha256:5f70bf18a086007016e948b04aed3b82103a36bea41755b6cddfaf10ace3c6ef"
"""The diff id of a layer without a file: two blocks of zeros."""
_CONTAINERD = "io.containerd.snapshotter.v1"


class Image(msgspec.Struct, frozen=True):
    """An image by what its configuration says."""

    id: str
    """sha256 of the configuration, in a classic store."""
    diff_ids: tuple[str, ...]
    """From the base up."""
    architecture: str = ""
    """Docker's name of the architecture that it is for; empty: it does not say."""


def read_image(inspected: object) -> Image | None:
    """Return an image from an engine's `/images/NAME/json`; None for what is none."""
    said = mapping(inspected)
    layers = mapping(said.get("RootFS")).get("Layers")
    return _image(string(said.get("Id")), layers, said.get("Architecture"))


def read_config(image_id: str, config: object) -> Image | None:
    """Return an image from its configuration; None for what is none. Whoever calls has compared it with the id."""
    said = mapping(config)
    rootfs = mapping(said.get("rootfs"))
    if _has_other_case(said, "rootfs", "architecture") or _has_other_case(rootfs, "diff_ids"):
        return None
    return _image(image_id, rootfs.get("diff_ids"), said.get("architecture"))


def _has_other_case(said: Mapping[str, Any], *names: str) -> bool:
    """Return whether it has one of the names in another case: engines take the last one in whatever case."""
    return any(key.casefold() in names and key not in names for key in said)


def _image(image_id: str, layers: object, architecture: object) -> Image | None:
    diff_ids = tuple(string(one) for one in layers[: _MOST_LAYERS + 1]) if isinstance(layers, list) else ()
    if not diff_ids or len(diff_ids) > _MOST_LAYERS or not all(map(_DIGEST.fullmatch, (image_id, *diff_ids))):
        return None
    return Image(image_id, diff_ids, architecture_of(architecture))


def architecture_of(said: object) -> str:
    """Return an image's architecture as it or its engine says it; empty for what is none."""
    name = string(said)
    return name if _ARCHITECTURE.fullmatch(name) else ""


def foreign(architecture: str, runs: Collection[str]) -> str:
    """Say why a robot that runs images of these architectures does not run one of another; nothing if it may."""
    if not architecture or not runs or architecture in runs:
        return ""
    return f"it is an image for {architecture}, and the robot runs {' and '.join(runs)}"


def has_classic_store(info: object) -> bool:
    """Return whether an engine's `/info` tells a store that finds layers by chain id; of one that is silent, not."""
    return bool(string(mapping(info).get("Driver"))) and not has_containerd_store(info)


def has_containerd_store(info: object) -> bool:
    """Return whether an engine's `/info` tells a store that finds layers by chain id when it pulls, and never loads."""
    status = mapping(info).get("DriverStatus")
    pairs = status[:64] if isinstance(status, list) else []
    return any(isinstance(one, list) and _CONTAINERD in one for one in pairs)


def chain_ids(diff_ids: Sequence[str]) -> list[str]:
    """Return the chain id of each layer."""
    chains: list[str] = []
    for diff_id in diff_ids:
        both = f"{chains[-1]} {diff_id}".encode() if chains else b""
        chains.append(f"sha256:{hashlib.sha256(both).hexdigest()}" if both else diff_id)
    return chains


def missing_layers(image: Image, there: Iterable[Image]) -> tuple[str, ...]:
    """Return the diff ids of an image's layers that a robot with these images lacks, from below."""
    known = {chain for one in there for chain in chain_ids(one.diff_ids)}
    lacks = [diff for diff, chain in zip(image.diff_ids, chain_ids(image.diff_ids), strict=True) if chain not in known]
    return tuple(lacks)


def config_name(image: Image) -> str:
    """Return how the configuration is called in an archive."""
    return f"{image.id.removeprefix('sha256:')}.json"


def layer_name(diff_id: str) -> str:
    """Return how a layer is called in an archive."""
    return f"{diff_id.removeprefix('sha256:')}.tar.gz"


def manifest(image: Image, tag: str) -> bytes:
    """Return an archive's list of images: this one, with all of its layers, whether they are in the archive or not."""
    layers = [layer_name(one) for one in image.diff_ids]
    return json.dumps([{"Config": config_name(image), "RepoTags": [tag], "Layers": layers}]).encode()


def history_sizes(history: object, layers: int) -> list[int] | None:
    """Return the bytes of each layer, uncompressed, from an engine's `/images/NAME/history`; None if they do not fit.

    Steps of a build that made no layer have no size, and so may a layer that is empty; then nobody can tell.
    """
    sizes = [integer(mapping(one).get("Size")) for one in history[:1000]] if isinstance(history, list) else []
    made = [size for size in reversed(sizes) if size]
    return made if len(made) == layers else None


def chain_sizes(image: Image, history: object) -> dict[str, int]:
    """Return chain id -> bytes of each layer, uncompressed; nothing where the engine's history does not tell."""
    sizes = iter(history_sizes(history, sum(one != _EMPTY for one in image.diff_ids)) or ())
    chains = zip(chain_ids(image.diff_ids), image.diff_ids, strict=True)
    return {chain: size for chain, one in chains if (size := 0 if one == _EMPTY else next(sizes, -1)) >= 0}
