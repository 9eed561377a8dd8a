"""Named volumes of an instance. They hold data: made when a service needs one, removed only when the user says so.

Source: Docker Engine API 1.41, "Create a volume".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from srprov.modules.module import INSTANCE, LABEL_FILTER, SOURCE, Module, canonical
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string, string_map
from srprov.wire import AnyQuery, Command, EngineCall, EngineQuery, Reply


@dataclass(frozen=True, kw_only=True, slots=True)
class VolumeParams:
    """What a playbook says of a volume."""

    instance: str
    source: str


class VolumeModule(Module[VolumeParams]):
    """The module of kind `volume`."""

    kind = "volume"
    params = VolumeParams
    holds_data = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled volumes."""
        return (EngineQuery(path="/volumes", params=(("filters", LABEL_FILTER),)),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return names and owners."""
        body = replies[0].json() if replies[0].ok else None
        found = []
        for item in mappings(body.get("Volumes") if isinstance(body, dict) else None):
            labels = string_map(item.get("Labels"))
            if INSTANCE in labels:
                state = {"source": labels.get(SOURCE, "")}
                name = string(item.get("Name"))
                found.append(Observed(module="volume", name=name, instance=labels[INSTANCE], state=state))
        return tuple(found)

    def check(self, name: str, want: VolumeParams, found: State | None) -> Change | None:
        """Ask only whether it is there; it is made with labels."""
        if found is not None:
            return None
        body = canonical({"Name": name, "Labels": {INSTANCE: want.instance, SOURCE: want.source}})
        create = EngineCall(method="POST", path="/volumes/create", body=body, accept=(201,))
        return Change(action=Action.CREATE, cause="not there", commands=(create,))

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it with its data."""
        return (EngineCall(method="DELETE", path=f"/volumes/{found.name}", accept=(204, 404)),)
