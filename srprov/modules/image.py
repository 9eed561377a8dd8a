"""Images: present on a robot under a tag or digest.

Whether it is right is a question of its name alone: a built image's tag is a hash of all that
went in, and a digest is one by nature. Images are nobody's: they are never removed as orphans. One of ours that has
lost its name, or that a build left, is named by its id.

Source: Docker Engine API 1.41, "Build an image", "Create an image".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import msgspec

from srprov.image_reference import is_of_a_build, is_plain, pull_parameters
from srprov.modules.container_leftover import BUILD, BUILD_HOST
from srprov.modules.module import INSTANCE, Module, Names
from srprov.modules.params import ParameterError
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string, string_map
from srprov.wire import AnyQuery, Command, CopyImage, EngineCall, EngineQuery, Reply

IMAGE_ID = re.compile("sha256:[0-9a-f]{64}")
DEFINITION = "srprov.cdf"
"""The label with the name of the definition that an image was built from."""
_LONG_S = 1800.0


class Missing(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot lacks of an image that another has."""

    layers: int
    of: int
    """Layers of the image."""
    bytes_: int
    """Of the missing layers; 0 if nobody knows."""
    exact: bool
    """They are what is sent, compressed; else, before they are compressed."""

    def __str__(self) -> str:
        """Say it in words."""
        size = f", {'' if self.exact else 'at most '}{self.bytes_ / (1 << 20):.1f} MiB" if self.bytes_ else ""
        return f"{self.layers} of {self.of} layers{size}"


class ImageParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of an image."""

    source: Literal["pull", "build", "copy", "cache"]
    """`cache`: from the controller's cache of layers."""
    blob: bytes | None = None
    """The build context as a tar, for `build`."""
    unpinned: bool = False
    """Its build names something that moves."""
    from_: str = ""
    """The robot that has it, for `copy`."""
    id: str = ""
    """The id of what is copied, where it was built before; empty: the plan has that robot build it. Of `cache`: the
    digest of its configuration."""
    way: Literal["", "thin", "registry", "whole"] = ""
    """How it is copied; empty: as it is possible."""
    base: str = ""
    """The image that it was built on, for `copy`; empty: nobody knows."""
    missing: Missing | None = None
    """What is copied; None where that only shows when it is."""
    runs: tuple[str, ...] = ()
    """Architectures that the robot runs, its own first: the image must be for one of them. Empty: any."""

    def __post_init__(self) -> None:
        """Refuse a source without what it takes."""
        if self.source == "build" and self.blob is None:
            raise ParameterError("source", "an image that is built needs a 'blob'")
        if self.source == "copy" and not self.from_:
            raise ParameterError("source", "an image that is copied needs a 'from'")
        if self.source == "cache" and not IMAGE_ID.fullmatch(self.id):
            raise ParameterError("source", "an image from the cache needs the 'id' of its configuration")


class ImageModule(Module[ImageParams]):
    """The module of kind `image`."""

    kind = "image"
    params = ImageParams
    shared = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List all images."""
        return (EngineQuery(path="/images/json"),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return one entry for every tag and every digest, and for every image of ours without a name.

        What has no id as images have is none: ids are kept, and believed, beside words of this machine's own.
        """
        if not replies[0].ok:
            return ()
        found = []
        for item in mappings(replies[0].json()):
            key, labels = string(item.get("Id")), string_map(item.get("Labels"))
            if not IMAGE_ID.fullmatch(key):
                continue
            state = {"id": key, "labels": labels}
            names = names_of(item) or [key] * has_label(labels)
            found += [Observed(module="image", name=name, instance="", state=state) for name in names]
        return tuple(found)

    def check(self, name: str, want: ImageParams, found: State | None) -> Change | None:
        """Ask only whether it is there; if not, it is pulled, built or copied."""
        if found is not None:
            return None
        how, command = _getting(name, want)
        note = "; base not pinned" if want.unpinned else ""
        return Change(action=Action.CREATE, cause=f"not on the robot; {how}{note}", commands=(command,))

    def is_own(self, name: str, want: ImageParams, names: Names) -> bool:
        """Take any that a registry may have; what is built is told by its content tag, which is not known here."""
        return want.source == "pull" and is_plain(name) and not is_of_a_build(name)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Untag; layers go when nothing else needs them.

        The engine would also remove what the image was built on, where that has no name: somebody else's, perhaps. So
        only the steps of its build go with it, `steps` in the state, newest first, and of those what nothing else is
        built on.
        """
        calls = [(found.name, (200, 404)), *((step, (200, 404, 409)) for step in found.state.get("steps", ()))]
        return tuple(untag(name, *codes) for name, codes in calls)


def untag(name: str, *accept: int) -> EngineCall:
    """Return what takes a name from an image, and leaves what that was built on."""
    return EngineCall(method="DELETE", path=f"/images/{name}", params=(("noprune", "true"),), accept=accept)


def names_of(item: Mapping[str, Any]) -> list[str]:
    """Return the tags and digests of an image in an engine's list, each as the engine has it."""
    both = (item.get("RepoTags"), item.get("RepoDigests"))
    return [str(name) for names in both if isinstance(names, list) for name in names if "<none>" not in str(name)]


def has_label(labels: Mapping[str, str]) -> bool:
    """Return whether labels say that srprov built an image, or a part of one; who builds on it inherits them."""
    return DEFINITION in labels or labels.get(INSTANCE) == BUILD


def _how(want: ImageParams) -> str:
    """Return way, layers and bytes of a copy, as far as they are known."""
    if want.way == "whole":
        return f"copied whole from {want.from_}"
    if want.source == "cache":
        return f"loaded from the controller's cache, {want.missing or 'the layers that are missing then'}"
    through = " through a registry" if want.way == "registry" else ""
    return f"copied{through} from {want.from_}, {want.missing or 'the layers that are missing then'}"


def _getting(name: str, want: ImageParams) -> tuple[str, Command]:
    """Return how an image gets to the robot, in words and as a command."""
    if want.source in ("copy", "cache"):
        copy = CopyImage(
            image=name, source_host=want.from_, id=want.id, way=want.way, base=want.base, runs=want.runs,
            timeout_s=_LONG_S,
        )  # fmt: skip
        return _how(want), copy
    if want.source == "pull":
        what = pull_parameters(name)
        pull = EngineCall(method="POST", path="/images/create", params=what, stream=True, timeout_s=_LONG_S)
        return "pulled by the robot", pull
    # rm and forcerm: a failed build leaves no container behind; those of a killed one are known by the host
    ends = (("forcerm", "true"), ("rm", "true"), ("t", name))
    options = (("dockerfile", "Dockerfile"), ("extrahosts", BUILD_HOST), *ends)
    blob = want.blob or b""
    build = EngineCall(method="POST", path="/build", params=options, blob=blob, stream=True, timeout_s=_LONG_S)
    return "built here", build
