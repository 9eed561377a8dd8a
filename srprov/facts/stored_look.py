"""A look at robots that is no look: facts that were stored, for whoever plans without robots. Asks nobody."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from srprov.definitions.model import Inventory
from srprov.facts.gather import Detail, Gathering
from srprov.facts.model import Snapshot
from srprov.resource import Resource
from srprov.wire import AnyQuery, Reply


class StoredLook(Gathering):
    """What `Gathering` would give, had robots said then what was stored; nothing of srprov's is on them."""

    sees = False

    def __init__(self, inventory: Inventory, snapshot: Snapshot) -> None:
        """Take the facts; the base class would begin to ask."""
        self.inventory, self._snapshot = inventory, snapshot

    def first(self, *, keep_mute: bool = False) -> Snapshot:
        """Return the facts."""
        return self._snapshot

    def closer(self, detail: Detail, *, keep_mute: bool = False) -> Snapshot:
        """Return the facts: there are no closer ones."""
        return self._snapshot

    def probe(self, snapshot: Snapshot, wants: Iterable[Resource]) -> Snapshot:
        """Return the snapshot: what must be asked for is not known."""
        return snapshot

    def ask_each(self, questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        """Answer nothing, as if each robot had failed meanwhile."""
        return {}

    def identity(self, name: str) -> str:
        """Tell nothing: nobody proves anything."""
        return ""

    def __exit__(self, *_error: object) -> None:
        """Do nothing: nobody was asked."""
