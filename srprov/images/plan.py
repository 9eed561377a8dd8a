"""What is known of an image before it is built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import msgspec

from srprov.definitions.model import VERSION_CONTROL
from srprov.errors import Location

LEFT_OUT = VERSION_CONTROL
"""Names of folders that are no part of what is shipped, at any depth."""


class ListedFile(msgspec.Struct, frozen=True):
    """One file below a folder, or the file itself that was listed (`path` is then empty)."""

    path: str
    """Relative to what was listed, with `/`."""
    executable: bool = False
    link: str | None = None
    """Where a symbolic link points to; None for a file."""

    @property
    def left_out(self) -> bool:
        """Whether it lies in what version control keeps."""
        return not LEFT_OUT.isdisjoint(self.path.split("/"))


class ContextFile(msgspec.Struct, frozen=True, kw_only=True):
    """One file of a build context."""

    path: str
    """Relative to the context's root."""
    content: bytes = b""
    mode: int = 0o644
    link: str | None = None


class Checkout(msgspec.Struct, frozen=True, kw_only=True):
    """What a code repository gives to an image."""

    commit: str
    files: tuple[ContextFile, ...]
    """With paths inside the repository."""
    moving: str = ""
    """In words, the name that led to the commit today and may lead elsewhere tomorrow; empty: it is pinned."""


class Dockerfile(msgspec.Struct, frozen=True, kw_only=True):
    """A Dockerfile as text, and where each of its lines comes from."""

    text: str
    lines: Mapping[int, Location] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Line of the text, from 1 -> place in the user's file."""
    base: str = ""
    """Canonical reference that the last stage starts from; as written where it holds a variable."""
    pinned: bool = False
    """Every image that it starts from is named by digest."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ImagePlan:
    """One image to be built: complete, and known without building."""

    tag: str
    """`srprov/<name>:<32 hex digits>`, a hash of all that goes in."""
    dockerfile: str
    context: bytes = field(repr=False)
    """An uncompressed tar; the Dockerfile in it is named `Dockerfile`."""
    base: str
    pinned: bool
    moving: tuple[str, ...] = ()
    """Of its code repositories, in words, what was looked up today and may be another commit tomorrow."""
    platforms: tuple[str, ...] = ()
    lines: Mapping[int, Location] = field(default_factory=lambda: MappingProxyType({}))
    """Line of `dockerfile`, from 1 -> place in the user's file."""
