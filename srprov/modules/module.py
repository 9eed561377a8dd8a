"""What every kind of resource can say of itself: the Module protocol, and helpers that several kinds share.

A module knows how to ask (`queries`), how to read the answers (`parse`), what is missing (`check`), and which
commands make it right (`commands`, `removal`). It never sees a connection. `check` is the only definition of
"already right": it is asked when planning, again before the first act on a robot, and again after.

Touches nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from srprov import untrusted
from srprov.resource import Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, Query, Reply

INSTANCE = "srprov.instance"
SERVICE = "srprov.service"
CONFIG_HASH = "srprov.config-hash"
CONFIG_PARTS = "srprov.config-parts"
SOURCE = "srprov.source"
STOP_GRACE = "srprov.stop-grace"

STATE_ROOT = "/var/lib/srprov"
"""Where rendered files live on a robot: STATE_ROOT/<instance>/."""
MEMORY_ROOT = "/run/srprov"
"""Where secrets live on a robot, in memory: MEMORY_ROOT/<instance>/secrets/."""


class Module(Protocol):
    """One kind of resource."""

    kind: str

    def queries(self) -> tuple[AnyQuery, ...]:
        """Say what to ask to see every resource of this kind that is ours, of all instances."""
        ...

    def parse(self, replies: Sequence[Reply], /) -> tuple[Observed, ...]:
        """Read the replies to `queries`, in the same order; garbage gives nothing, never an error."""
        ...

    def check(self, want: Resource, found: State | None, /) -> Change | None:
        """Say what is missing; None when it is right."""
        ...

    def commands(self, want: Resource, change: Change, /) -> tuple[Command, ...]:
        """Say what makes it right, given the change that `check` found."""
        ...

    def removal(self, found: Observed, /) -> tuple[Command, ...]:
        """Say what takes it away."""
        ...


@runtime_checkable
class Probing(Protocol):
    """A kind whose resources cannot be found by looking around, only by asking for one that is wanted."""

    def probes(self, want: Resource, /) -> tuple[Query, ...]:
        """Say what to ask to see whether this one is right."""
        ...

    def probed(self, want: Resource, replies: Sequence[Reply], /) -> Observed:
        """Read the replies to `probes`; owned by nobody, so that nothing is ever removed for it."""
        ...


def canonical(value: object) -> str:
    """Return the one JSON text of a value: sorted keys, no spaces."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)


def digest(value: object, length: int = 64) -> str:
    """Return the sha256 of a JSON value in hex, shortened to `length` digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()[:length]


as_list, as_text, as_labels = untrusted.mappings, untrusted.string, untrusted.labels


def as_int(text: str, default: int = 0) -> int:
    """Return a whole number that came from a robot as text."""
    return untrusted.integer(text, default=default)


LABEL_FILTER = canonical({"label": [INSTANCE]})
"""Docker's filter for everything that carries our instance label."""
