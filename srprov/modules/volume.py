"""Named volumes of an instance. They hold data: made when a service needs one, removed only when the user says so.

A volume carries who made it as a label (`owner`, which only the controller that made it can check), and one that was
copied from another robot whose copy it is. Data is copied into a volume of another name first, the half copy: it takes
the place of the real one in one rename after its hash was compared. While the half copy is there, whatever has the real
name is worth nothing yet.

Source: Docker Engine API 1.41, "Create a volume".
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass

from srprov.modules.container_form import WORD
from srprov.modules.module import INSTANCE, LABEL_FILTER, SOURCE, Module, Names, canonical
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string, string_map
from srprov.wire import AnyQuery, Command, CopyVolume, EngineCall, EngineQuery, Reply, Run, quote

OWNER = "srprov.owner"
COPY = "srprov.copy"
_HALF = "srprov-copy."
_NAME = "srprov."


def volume_name(instance: str, name: str) -> str:
    """Return the name of a data volume in Docker."""
    return f"{_NAME}{instance}.{name}"


def half_copy(name: str) -> str:
    """Return the name of the volume that data is copied into first; no name of a real one begins so."""
    return _HALF + name.removeprefix(_NAME)


def moment(created: str) -> float:
    """Return an engine's time as seconds since the epoch; 0 for what is none."""
    try:
        return dt.datetime.fromisoformat(created[:19] + "+00:00" if created.endswith("Z") else created).timestamp()
    except (ValueError, OverflowError):
        return 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class VolumeParams:
    """What a playbook says of a volume."""

    instance: str
    source: str
    owner: str = ""
    """Proof of who made it, for a label."""
    from_: str = ""
    """The robot that the data is copied from, and then removed on."""
    copy: str = ""
    """Proof that it is a whole copy of what `from` has, for a label."""


class VolumeModule(Module[VolumeParams]):
    """The module of kind `volume`."""

    kind = "volume"
    params = VolumeParams
    holds_data = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled volumes."""
        return (EngineQuery(path="/volumes", params=(("filters", LABEL_FILTER),)),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return names, owners and where they lie."""
        body = replies[0].json() if replies[0].ok else None
        items = mappings(body.get("Volumes") if isinstance(body, dict) else None)
        names = {string(item.get("Name")) for item in items}
        found = []
        for item in items:
            labels, name = string_map(item.get("Labels")), string(item.get("Name"))
            if INSTANCE in labels:
                state = {
                    "source": labels.get(SOURCE, ""),
                    "owner": labels.get(OWNER, ""),
                    "copy": labels.get(COPY, ""),
                    "created": string(item.get("CreatedAt")),
                    "place": string(item.get("Mountpoint")),
                    "half": name.startswith(_HALF) or half_copy(name) in names,
                }
                found.append(Observed(module="volume", name=name, instance=labels[INSTANCE], state=state))
        return tuple(found)

    def check(self, name: str, want: VolumeParams, found: State | None) -> Change | None:
        """Ask only whether it is there, and whole; it is made with labels."""
        if found is not None and not found.get("half"):
            return None
        labels = {INSTANCE: want.instance, SOURCE: want.source}
        labels |= {key: text for key, text in ((OWNER, want.owner), (COPY, want.copy)) if text}
        half = half_copy(name)
        cleared = () if found is None else (_remove(name), _remove(half))
        if not want.from_:
            cause = "not there" if found is None else "only half copied"
            return Change(action=Action.CREATE, cause=cause, commands=(*cleared, _create(name, labels)))
        commands = (
            *(cleared or (_remove(half),)),
            _create(half, {INSTANCE: want.instance, SOURCE: want.source}),
            CopyVolume(volume=name, into=half, source_host=want.from_),
            _create(name, labels),
            Run(script=_take_place(half, name)),
            _remove(half),
        )
        cause = f"copied from {want.from_}, compared by hash, then removed there"
        return Change(action=Action.RUN, cause=cause, commands=commands)

    def is_own(self, name: str, want: VolumeParams, names: Names) -> bool:
        """Compare name and owner."""
        word = name.removeprefix(f"srprov.{names.instance}.")
        owner = (want.instance, want.source) == (names.instance, names.source)
        return owner and word != name and WORD.fullmatch(word) is not None

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it with its data."""
        return (_remove(found.name),)

    def keeps(self, found: State) -> bool:
        """Return whether there is data in it: a half copy has none that is not elsewhere."""
        return not found.get("half")

    def taken_from(self, want: VolumeParams) -> str:
        """Return the robot that the data comes from."""
        return want.from_

    def is_copy(self, want: VolumeParams, found: State) -> bool:
        """Compare the proof."""
        return bool(want.copy) and found["copy"] == want.copy


def _create(name: str, labels: dict[str, str]) -> EngineCall:
    body = canonical({"Name": name, "Labels": labels})
    return EngineCall(method="POST", path="/volumes/create", body=body, accept=(201,))


def _remove(name: str) -> EngineCall:
    return EngineCall(method="DELETE", path=f"/volumes/{name}", accept=(204, 404))


def _take_place(half: str, name: str) -> str:
    """Return the script that renames the data; the real volume is empty, or `mv` fails."""
    place = "docker volume inspect --format '{{.Mountpoint}}'"
    # what is removed elsewhere next must not be lost with this robot's power
    rename = 'sync -f "$from" && mv -T "$from" "$to" && mkdir "$from" && sync -f "$to"'
    return f"from=$({place} {quote(half)}) && to=$({place} {quote(name)}) && {rename}"
