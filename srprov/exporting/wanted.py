"""What is exported, and how the controller's files are read for it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from srprov.definitions.model import Definitions
from srprov.exporting.mounts import Shipped
from srprov.exporting.variables import Open
from srprov.images.context import Listing, Read
from srprov.images.tag import Checkouts


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """One experiment, placed or not."""

    definitions: Definitions
    """As they were read with `open`; the experiment with every instance as a service of its own."""
    placed: Mapping[str, str]
    """Service -> robot; empty: all on one PC."""
    robots: Mapping[str, str] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Robot -> the address that others reach, as far as known."""
    profiles: bool = False
    """Profiles are still to be chosen: services keep theirs."""
    open: Open
    env_files: Mapping[str, Mapping[str, str]] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """Service in the EDF -> what its env_files say."""
    texts: Mapping[str, str]
    """Path as it is shown -> text, of the EDF and the CDFs that are YAML."""
    edf: str
    """The EDF's path, as it is shown."""
    notes: tuple[str, ...] = ()
    listing: Listing
    read: Read
    shipped: Shipped
    checkout: Checkouts
    lossy: bool = False
    """Write what can be, also when something is lost that the experiment relies on."""
