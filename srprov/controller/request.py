"""What the user asks for beside the files. Values only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec

from srprov.image_reference import bundled_name

if TYPE_CHECKING:
    from srprov.controller.owners import Owner
    from srprov.definitions.labpolicy import LabPolicy
    from srprov.definitions.playbookmodel import Playbook

SEARCH_LIMIT_S = 30.0
"""How long a search for the best placement may take before the best one found is used."""


class BundledImage(msgspec.Struct, frozen=True):
    """An image that this machine has of a bundle."""

    id: str
    """The digest of its configuration."""
    architecture: str
    """Empty: it does not say."""

    @property
    def name(self) -> str:
        """Return its name on robots."""
        return bundled_name(self.id)


class PlanRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What the user asks for beside the files."""

    instance: str = ""
    """Empty: the experiment's name."""
    profiles: tuple[str, ...] = ()
    """Of services that are wanted beside those that always are; `*` stands for all."""
    placed: Mapping[str, str] = msgspec.field(default_factory=dict)
    """Service -> the robot where it stays if it can, as if it ran there now: where it was when it was run elsewhere."""
    bundled: Mapping[str, tuple[BundledImage, ...]] = msgspec.field(default_factory=dict)
    """Service -> images that it may have, all of which are in this machine's cache of layers; it has the first one that
    its robot runs."""
    reassign: bool = False
    """Let running services move when that is cheaper."""
    reassign_unreachable: bool = False
    """Place services of robots that cannot be reached elsewhere."""
    history: tuple[Mapping[str, float], ...] = ()
    """Earlier runs, each robot -> the cost that was allocated to it; for fairness."""
    adopt: bool = False
    """Take over an instance that another file made."""
    data: str = ""
    """What becomes of data whose service goes elsewhere: `move`, `leave`, or empty: it stays, with its service."""
    copy: str = ""
    """How images get from one robot to another: `thin`, `whole`, or as it is possible."""
    owner: Owner | None = None
    """Who owns the instance's volumes; None: nobody asks, as nothing will be attached."""
    rotate_keys: bool = False
    """An encrypted overlay gets new keys on all of its robots."""
    exact: bool = False
    """Ask the engines of themselves even if nothing is new: a plan file holds robots to what they said."""
    playbooks: tuple[Playbook, ...] = ()
    """The user's own, from his folder."""
    allowed: frozenset[str] = frozenset()
    """Kinds of permission that the user gave."""
    policies: tuple[LabPolicy, ...] = ()
    """The machine's and the user's own: what is allowed at all."""
    trials: bool = False
    """Trials will be run: each makes its containers anew, also those that are there."""
    images_only: bool = False
    """Plan the images, and nothing that runs them."""
    targets: tuple[str, ...] = ()
    """The services that something is done for, as the user names them; empty: all."""
    search_limit_s: float | None = SEARCH_LIMIT_S
    """Of each search for a placement; None: no limit."""
