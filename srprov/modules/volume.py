"""Named volumes of an instance. They hold data: made when a service needs one, removed only when the user says so.

A volume carries who made it as a label (`owner`, which only the controller that made it can check), and one that was
copied from another robot whose copy it is. Data is copied into a volume of another name first, the half copy: it takes
the place of the real one in one rename after its hash was compared. While the half copy is there, whatever has the real
name is worth nothing yet. A seed comes into a volume in the same way, once, when it is made.

What has the name of an instance's volume is that instance's, whoever made it and whatever labels say, and without its
owner's proof somebody else's: an engine that is told to make one that is there says that it did, and leaves in it what
is there.

Source: Docker Engine API 1.41, "Create a volume".
"""

from __future__ import annotations

import datetime as dt
import hashlib
import re
from collections.abc import Mapping, Sequence

import msgspec

from srprov import names
from srprov.modules.container_form import WORD
from srprov.modules.module import INSTANCE, LABEL_FILTER, SOURCE, STATE_ROOT, Module, Names, canonical
from srprov.modules.params import ParameterError
from srprov.modules.tree import plain_digest, top_of
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import mappings, string, string_map, text
from srprov.wire import AnyQuery, Command, CopyVolume, EngineCall, EngineQuery, Put, Reply, Run, quote

OWNER = "srprov.owner"
COPY = "srprov.copy"
SEED = "srprov.seed"
SERVICES = "srprov.services"
_HASH = re.compile(r"[0-9a-f]{24}")
_USER = re.compile(r"([0-9]{1,10}(:[0-9]{1,10})?)?")
_LONGEST = 64
"""Characters of a proof, or of a time: they are kept here for what `--adopt` took over."""
HALF = "srprov-copy."
"""How the name of a volume begins that is not a real one yet."""
_NAME = "srprov."
_NAME_FILTER = canonical({"name": [_NAME]})


def volume_name(instance: str, name: str) -> str:
    """Return the name of a data volume in Docker."""
    return f"{_NAME}{instance}.{name}"


def _named_for(name: str) -> str:
    """Return the instance whose volume `volume_name` calls so, or nothing."""
    instance, _, own = name.removeprefix(_NAME).partition(".")
    ours = name.startswith(_NAME) and names.valid("instance", instance) and WORD.fullmatch(own)
    return instance if ours else ""


def half_copy(name: str) -> str:
    """Return the name of the volume that data is copied into first; no name of a real one begins so."""
    return HALF + name.removeprefix(_NAME)


def moment(created: str) -> float:
    """Return an engine's time as seconds since the epoch; 0 for what is none."""
    try:
        return dt.datetime.fromisoformat(created[:19] + "+00:00" if created.endswith("Z") else created).timestamp()
    except (ValueError, OverflowError):
        return 0.0


class VolumeParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a volume."""

    instance: str
    source: str
    owner: str = ""
    """Proof of who made it, for a label."""
    from_: str = ""
    """The robot that the data is copied from, and then removed on."""
    copy: str = ""
    """Proof that it is a whole copy of what `from` has, for a label."""
    blob: bytes | None = None
    """What it holds when it is made: a tar whose single top entry is a folder."""
    user: str = ""
    """Whose that is: `UID` or `UID:GID`; empty: root's."""
    seed: str = ""
    """What the volume on `from` was made with, for a label."""
    services: tuple[str, ...] = ()
    """Whose data it is, for a label: who may write there when it is made, or else reads it, by the names in the EDF."""

    def __post_init__(self) -> None:
        """Refuse what a plan file could make a shell do, or a label say."""
        if not _USER.fullmatch(self.user):
            raise ParameterError("user", "user: a number, or two with a colon")
        if self.seed and not _HASH.fullmatch(self.seed):
            raise ParameterError("seed", "seed: 24 digits of a hash")
        if not all(names.valid("service", one) for one in self.services):
            raise ParameterError("services", "services: names of services")

    @property
    def made_with(self) -> str:
        """Return the name of what it holds when it is made; empty: nothing, or nobody knows."""
        return self.seed or (hashlib.sha256(self.blob).hexdigest()[:24] if self.blob else "")


class VolumeModule(Module[VolumeParams]):
    """The module of kind `volume`."""

    kind = "volume"
    params = VolumeParams
    holds_data = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List labelled volumes, and those with names of ours."""
        return tuple(EngineQuery(path="/volumes", params=(("filters", one),)) for one in (LABEL_FILTER, _NAME_FILTER))

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return names, owners and where they lie."""
        bodies = [one.json() if one.ok else None for one in replies]
        items = [item for one in bodies for item in mappings(one.get("Volumes") if isinstance(one, dict) else None)]
        by_name = {string(item.get("Name")): (item, string_map(item.get("Labels"))) for item in items}
        # an engine takes a filter for a pattern, and what anybody called so says nothing of the data in the real one
        halves = {name for name, (_, labels) in by_name.items() if name.startswith(HALF) and INSTANCE in labels}
        found = []
        for name, (item, labels) in by_name.items():
            if instance := _named_for(name) or labels.get(INSTANCE):
                state = {
                    "source": labels.get(SOURCE, ""),
                    "owner": text(labels.get(OWNER), length=_LONGEST),
                    "copy": text(labels.get(COPY), length=_LONGEST),
                    "seed": seed if _HASH.fullmatch(seed := labels.get(SEED, "")) else "",
                    "created": text(item.get("CreatedAt"), length=_LONGEST),
                    "place": string(item.get("Mountpoint")),
                    "half": name in halves or half_copy(name) in halves,
                }
                if made_for := [one for one in labels.get(SERVICES, "").split(",") if names.valid("service", one)]:
                    state["services"] = made_for  # of an older srprov's nobody knows
                found.append(Observed(module="volume", name=name, instance=instance, state=state))
        return tuple(found)

    def check(self, name: str, want: VolumeParams, found: State | None) -> Change | None:
        """Ask only whether it is there, and whole; it is made with labels."""
        if found is not None and not found.get("half"):
            return None
        labels = {INSTANCE: want.instance, SOURCE: want.source}
        given = ((OWNER, want.owner), (COPY, want.copy), (SEED, want.made_with), (SERVICES, ",".join(want.services)))
        labels |= {key: text for key, text in given if text}
        half = half_copy(name)
        cleared = () if found is None else (remove_volume(name), remove_volume(half))
        cause = "not there" if found is None else "only half copied"
        if not want.from_ and want.blob is None:
            return Change(action=Action.CREATE, cause=cause, commands=(*cleared, create_volume(name, labels)))
        commands = (
            *(cleared or (remove_volume(half),)),
            create_volume(half, {INSTANCE: want.instance, SOURCE: want.source}),
            *((CopyVolume(volume=name, into=half, source_host=want.from_),) if want.from_ else _fill(half, want)),
            create_volume(name, labels),
            Run(script=_take_place(half, name)),
            remove_volume(half),
        )
        if want.blob is not None and not want.from_:
            top = top_of(want.blob)
            cause = f"{cause}, made with its seed {f'{top} ' if top else ''}({len(want.blob)} bytes)"
            return Change(action=Action.CREATE, cause=cause, commands=commands)
        cause = f"copied from {want.from_}, compared by hash, then removed there"
        return Change(action=Action.RUN, cause=cause, commands=commands)

    def left_alone(self, want: VolumeParams, found: State) -> str:
        """Say so of one that was made with something else: what it holds since is its services' own."""
        if not want.made_with or found.get("half") or found.get("seed") == want.made_with:
            return ""
        before = "another state of its seed" if found.get("seed") else "no seed"
        return f"was made with {before}, and its data is kept as it is; it is made anew only once it was removed there"

    def is_own(self, name: str, want: VolumeParams, names: Names) -> bool:
        """Compare name and owner."""
        word = name.removeprefix(f"srprov.{names.instance}.")
        owner = (want.instance, want.source) == (names.instance, names.source)
        plain = want.blob is None or plain_digest(want.blob) != ""
        return owner and plain and word != name and WORD.fullmatch(word) is not None

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it with its data."""
        return (remove_volume(found.name),)

    def keeps(self, found: State) -> bool:
        """Return whether there is data in it: a half copy has none that is not elsewhere."""
        return not found.get("half")

    def taken_from(self, want: VolumeParams) -> str:
        """Return the robot that the data comes from."""
        return want.from_

    def is_copy(self, want: VolumeParams, found: State) -> bool:
        """Compare the proof."""
        return bool(want.copy) and found["copy"] == want.copy


def create_volume(name: str, labels: Mapping[str, str]) -> EngineCall:
    """Return what makes a volume; one that is there stays as it is."""
    body = canonical({"Name": name, "Labels": dict(labels)})
    return EngineCall(method="POST", path="/volumes/create", body=body, accept=(201,))


def remove_volume(name: str) -> EngineCall:
    """Return what removes a volume with its data."""
    return EngineCall(method="DELETE", path=f"/volumes/{name}", accept=(204, 404))


def _fill(half: str, want: VolumeParams) -> tuple[Command, ...]:
    """Return what brings the seed into a volume that is not the real one yet."""
    # beside the instance's files, where what a killed run leaves is seen and cleaned up
    tar = f"{STATE_ROOT}/{want.instance}/seed-{want.made_with}"
    place = f"to=$(docker volume inspect --format '{{{{.Mountpoint}}}}' {quote(half)})"
    owner = f' && chown -hR {quote(want.user)} "$to"' if want.user else ""
    unpack = f'{place} && tar -xf {quote(tar)} -C "$to" --strip-components=1{owner}; s=$?; rm -f {quote(tar)}; exit $s'
    return Put(path=tar, content=want.blob or b"", mode=0o600, timeout_s=600), Run(script=unpack, timeout_s=600)


def _take_place(half: str, name: str) -> str:
    """Return the script that renames the data; the real volume is empty, or `mv` fails."""
    place = "docker volume inspect --format '{{.Mountpoint}}'"
    # what is removed elsewhere next must not be lost with this robot's power
    rename = 'sync -f "$from" && mv -T "$from" "$to" && mkdir "$from" && sync -f "$to"'
    return f"from=$({place} {quote(half)}) && to=$({place} {quote(name)}) && {rename}"
