"""Named volumes that several services mount: they hold the same data, so their services share a robot.

Takes the services as they were built; gives groups, or adds to `Findings`. Pure. Each replica of a service has a volume
of its own, `NAME-1` to `NAME-n`, and each robot of a service with `per_robot` one; neither can be shared with a service
that runs once, since nobody could say with which of them. Whose data a service shares, and whether it may write there,
is the EDF's word: a CDF may be a stranger's, and names volumes as it likes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions.model import Service
from srprov.definitions.values import flag, text
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Seq

Groups = tuple[tuple[str, ...], ...]


def users(services: Mapping[str, Service]) -> dict[str, list[str]]:
    """Return volume -> the services that mount it, in name order; only volumes of more than one."""
    found: dict[str, list[str]] = {}
    for name, service in sorted(services.items()):
        for source in sorted({mount.source for mount in service.runtime.mounts if mount.kind == "volume"}):
            found.setdefault(source, []).append(name)
    return {volume: names for volume, names in found.items() if len(names) > 1}


def with_shared(groups: Groups, services: Mapping[str, Service]) -> Groups:
    """Return groups that must share a robot, joined with those that share a volume; what touches is one group."""
    single = {name for name, one in services.items() if one.per_robot is None and one.replicas == 1}
    shared = {tuple(name for name in names if name in single) for names in users(services).values()}
    whole: dict[str, set[str]] = {}  # service -> its group, which is one object for all that are in it
    for names in (*groups, *shared):
        touching = {id(found): found for name in names if (found := whole.get(name))}
        group = set(names).union(*touching.values())
        if not (len(touching) == 1 and group in touching.values()):
            whole.update(dict.fromkeys(group, group))
    merged = {tuple(sorted(group)) for group in whole.values()}
    return tuple(sorted(group for group in merged if len(group) > 1 or group in groups))


def check(known: Mapping[str, Map], services: Mapping[str, Service], findings: Findings) -> None:
    """Add services that share a volume and cannot be on one robot, or write to one against the EDF's word."""
    said = {name: _said(known[name]) for name in services}
    for one in services.values():
        _check_writes(one, known, said[one.name], findings)
    for volume, names in users(services).items():
        _check_kinds(volume, [services[name] for name in names], known, findings)
        left = [services[name] for name in names if volume not in said[name]]
        _check_said(volume, [services[name] for name in names], left, known, findings)
        pins = [(name, known[name].entries["robot"]) for name in names if "robot" in known[name].entries]
        for name, pin in pins[1:]:
            first, where = pins[0][0], text(pins[0][1])
            if text(pin) != where:
                message = f"'{name}' is on '{text(pin)}', but shares the volume '{volume}' with '{first}' on '{where}'"
                hint = "put them on one robot, or give each a volume of its own"
                findings.add(pin, message, ("services", name, "robot"), hint, code=Code.RELATION)
    _check_replicas(known, services, findings)


def _check_kinds(
    volume: str, services: Sequence[Service], known: Mapping[str, Map], findings: Findings
) -> None:  # fmt: skip
    for one in services:
        each = "replica" if one.replicas > 1 else "robot" if one.per_robot is not None else ""
        other = next((s for s in services if s is not one and (each == "replica" or s.per_robot is None)), None)
        if each and other:
            message = (
                f"each {each} of '{one.name}' has a volume '{volume}' of its own, so '{other.name}' cannot share it"
            )
            place = nodes.key_or_value(known[other.name], "volumes")
            findings.add(place, message, ("services", other.name, "volumes"), "give it another name", code=Code.VOLUME)
            return


def _check_said(
    volume: str, services: Sequence[Service], left: Sequence[Service], known: Mapping[str, Map], findings: Findings
) -> None:
    """Check that the EDF leaves none without the volume; but services of one CDF have one author anyway."""
    if not left or (len(left) == len(services) and len({one.cdf for one in services}) == 1):
        return
    other = next(one.name for one in services if one is not left[0])
    message = f"the CDF of '{left[0].name}' mounts the volume '{volume}', which '{other}' has"
    hint = "name it in the `volumes` of this service in the EDF too, if they shall share it"
    place = nodes.key_or_value(known[left[0].name], "volumes")
    findings.add(place, message, ("services", left[0].name, "volumes"), hint, code=Code.VOLUME)


def by_cdf(one: Service, entry: Map) -> frozenset[str]:
    """Return the volumes of a service that the EDF does not name for it; `entry` is what stands there."""
    return frozenset(_volumes(one) - _said(entry).keys())


def with_same_cdf(services: Mapping[str, Service]) -> dict[str, Service]:
    """Return services that know which other ones have their CDF."""
    having: dict[str, set[str]] = {}
    for name, one in services.items():
        having.setdefault(one.cdf, set()).add(name)
    same = {cdf: frozenset(names) for cdf, names in having.items() if cdf}
    return {name: replace(one, same_cdf=same.get(one.cdf, frozenset())) for name, one in services.items()}


def written(one: Service) -> set[str]:
    """Return the volumes that a service may write to, as the EDF names them."""
    return {mount.source for mount in one.runtime.mounts if mount.kind == "volume" and not mount.read_only}


def _check_writes(one: Service, known: Mapping[str, Map], said: Mapping[str, bool], findings: Findings) -> None:
    """Check that a service writes to no volume that the EDF has it read alone: its CDF may mount it once more."""
    for volume in sorted(volume for volume in written(one) if said.get(volume) is False):
        message = f"the CDF of '{one.name}' may write to the volume '{volume}', which the EDF has it read alone"
        hint = "take `ro` away in the `volumes` of this service in the EDF, if it shall write there"
        place = nodes.key_or_value(known[one.name], "volumes")
        findings.add(place, message, ("services", one.name, "volumes"), hint, code=Code.VOLUME)


def _said(entry: Map) -> dict[str, bool]:
    """Return the sources of a service's volumes that its own entry names, and whether it may write there by that."""
    given = entry.entries.get("volumes")
    found: dict[str, bool] = {}
    for one in given.items if isinstance(given, Seq) else ():
        if isinstance(one, Map):
            if text(one.entries.get("type")) == "bind":
                continue  # a path, also where it is called as a volume is
            source, reads = text(one.entries.get("source")), flag(one.entries.get("read_only"))
        else:
            source, *_, modes = [*text(one).split(":"), "", ""][:3]
            reads = "ro" in modes.split(",")
        found[source] = found.get(source, False) or not reads
    return found


def _check_replicas(known: Mapping[str, Map], services: Mapping[str, Service], findings: Findings) -> None:
    """Check that no volume has the name of a replica's."""
    taken = {
        f"{volume}-{number}": one.name
        for one in services.values()
        for volume in _volumes(one)
        for number in range(1, one.replicas + 1 if one.replicas > 1 else 1)
    }
    for one in services.values():
        for volume in _volumes(one) & taken.keys():
            message = f"'{volume}' is also the name of the volume of a replica of '{taken[volume]}'"
            place = nodes.key_or_value(known[one.name], "volumes")
            findings.add(place, message, ("services", one.name, "volumes"), "give it another name", code=Code.VOLUME)


def _volumes(service: Service) -> set[str]:
    return {mount.source for mount in service.runtime.mounts if mount.kind == "volume"}
