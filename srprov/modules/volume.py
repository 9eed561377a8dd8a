"""Named volumes of an instance. They hold data: made when a service needs one, removed only when the user says so.

Wanted parameters: `instance`, `source`. Source: Docker Engine API 1.41, "Create a volume".
"""

from __future__ import annotations

from collections.abc import Sequence

from srprov.modules.module import INSTANCE, LABEL_FILTER, SOURCE, as_labels, as_list, as_text, canonical
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Reply


class VolumeModule:
    """The module of kind `volume`."""

    kind = "volume"

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled volumes."""
        return (EngineQuery(path="/volumes", params=(("filters", LABEL_FILTER),)),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return names and owners."""
        body = replies[0].json() if replies[0].ok else None
        found = []
        for item in as_list(body.get("Volumes") if isinstance(body, dict) else None):
            labels = as_labels(item.get("Labels"))
            if INSTANCE in labels:
                state = {"source": labels.get(SOURCE, "")}
                name = as_text(item.get("Name"))
                found.append(Observed(module="volume", name=name, instance=labels[INSTANCE], state=state))
        return tuple(found)

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Ask only whether it is there."""
        return Change(action=Action.CREATE, cause="not there") if found is None else None

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Create it, labelled."""
        labels = {INSTANCE: want.params["instance"], SOURCE: want.params["source"]}
        body = canonical({"Name": want.name, "Labels": labels})
        return (EngineCall(method="POST", path="/volumes/create", body=body, accept=(201,)),)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it with its data."""
        return (EngineCall(method="DELETE", path=f"/volumes/{found.name}", accept=(204, 404)),)
