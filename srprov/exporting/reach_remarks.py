"""What becomes of the overlay and of what depends on it, in words, at the fields that say it. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from srprov.definitions.model import Experiment, Service
from srprov.exporting.model import ADAPTED, DROPPED, EXACT, REFUSED, Machine, Path, Remark
from srprov.network.layout import ON_OVERLAY

_NETWORK = ("network",)


def on_one_machine(experiment: Experiment, services: Sequence[Service]) -> Iterator[Remark]:
    """Yield what is to be said when no service knows another machine."""
    words = {
        "overlay": (ADAPTED, "the network that Compose makes on this machine"),
        "host": (EXACT, ""),
        "both": (ADAPTED, "the machine's own network; its address on the overlay is the machine's own"),
        "none": (EXACT, ""),
    }
    for one in services:
        kind, why = words[one.network]
        yield _at(one, "network", kind, why)
    if experiment.network.encryption != "none":
        yield _of_network("encryption", DROPPED, "nothing of it leaves this machine")
    yield _of_network("subnet", EXACT, "")


def on_several_machines(experiment: Experiment, services: Sequence[Service]) -> Iterator[Remark]:
    """Yield what is to be said when services know those of other machines."""
    for one in services:
        if one.network not in ON_OVERLAY:
            yield _at(one, "network", EXACT, "")
            continue
        why = "its robot's own network, with the others' names in its hosts file: it is not apart from the robot"
        yield _at(one, "network", ADAPTED, why)
        for address, published, inside, protocol in one.runtime.ports:
            kind = ADAPTED if published == inside and not address else DROPPED
            yield _at(one, "ports", kind, f"it listens on port {inside}/{protocol} of the robot itself")
        if one.runtime.hostname:
            yield _at(one, "hostname", ADAPTED, "the container has the robot's hostname; others know it by this one")
        if lost := sorted(name for name in one.runtime.sysctls if name.startswith("net.")):
            why = f"the engine refuses {', '.join(lost)} in the robot's own network"
            yield _at(one, "sysctls", DROPPED, why)
    if experiment.network.encryption != "none" and any(one.network in ON_OVERLAY for one in services):
        why = "Compose would send between robots in the clear what the experiment wants encrypted"
        yield _of_network("encryption", REFUSED, why)
    yield _of_network("subnet", DROPPED, "no network of Compose's spans robots")


def clashes(experiment: Experiment, machine: Machine) -> Iterator[Remark]:
    """Yield a refusal for services that would listen on one port of a robot, as far as they say where they listen."""
    first: dict[tuple[int, str], str] = {}
    for name in machine.services:
        one = experiment.services[name]
        ports = {(inside, protocol) for _, _, inside, protocol in one.runtime.ports} | set(one.runtime.expose)
        for port, protocol in sorted(ports if one.network != "none" else ()):
            other = first.setdefault((port, protocol), name)
            if other != name:
                why = f"'{other}' listens on port {port}/{protocol} too, and both would share {machine.robot}'s network"
                yield _at(one, "ports" if one.runtime.ports else "expose", REFUSED, why)


def _at(service: Service, field: str, kind: str, words: str) -> Remark:
    return Remark(path=("services", service.instance_of or service.name, field), kind=kind, words=words)


def _of_network(field: str, kind: str, words: str) -> Remark:
    path: Path = (*_NETWORK, field)
    return Remark(path=path, kind=kind, words=words)
