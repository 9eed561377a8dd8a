"""One robot's facts: the replies of `host_queries`, the inventory's word and psutil's, put together.

Takes a Host, replies, Measures and the controller's clock; gives HostFacts. Pure. Everything that a robot says is
untrusted: whatever it answers, the result is a valid HostFacts with plain text and bounded numbers, and what is not
known keeps the model's default.
Source: proc(5), sysfs-class-net, Docker Engine API 1.41 (`/_ping`, `/info`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.definitions.model import Host
from srprov.facts.amounts import amounts
from srprov.facts.answers import Disks, Files, OsIdentity
from srprov.facts.engine import engine_disk, read_engine
from srprov.facts.equipment import equipment
from srprov.facts.hardware import detect_tags
from srprov.facts.lifelines import lifelines
from srprov.facts.links import find_underlay
from srprov.facts.model import HostFacts
from srprov.facts.probes import EMULATORS, ENGINE, PING, PROBES, counters
from srprov.facts.speeds import traffic_mbit, with_speeds
from srprov.facts.spelled import read_spelled
from srprov.facts.wireguard import WireguardAnswer
from srprov.session import Measures
from srprov.untrusted import text
from srprov.wire import EngineQuery, Query, Reply

_ARCHITECTURES = {
    "x86_64": "amd64",
    "amd64": "amd64",
    "aarch64": "arm64",
    "arm64": "arm64",
    "armv8l": "arm",
    "armv7l": "arm",
    "armv6l": "arm",
    "arm": "arm",
    "i386": "386",
    "i686": "386",
    "386": "386",
    "riscv64": "riscv64",
    "ppc64le": "ppc64le",
    "s390x": "s390x",
}
_HALVES = {"x86_64": "i386", "amd64": "i386", "aarch64": "arm", "arm64": "arm"}
"""What a 64-bit processor is to a 32-bit system."""
_UPTIME = re.compile(r"^/proc/uptime:([0-9]{1,10})\.([0-9]{2}) ", re.MULTILINE)
"""In the answer of the probe `files`: when the counters were read first, in seconds and their hundredths."""


def host_queries(*, info: bool = True) -> tuple[Query | EngineQuery, ...]:
    """Return everything to ask a robot for its facts, in the order that `parse_host` expects the replies.

    Without `info` the last one, `INFO`, is left out, and its reply may follow later or not at all.
    """
    probes = (Query(command=probe.command, in_place=True) for probe in PROBES)
    return (*probes, *(ENGINE if info else (PING,)))


def later_query(replies: Sequence[Reply]) -> Query:
    """Ask for the second reading of the counters; without a first one nothing is waited for, as nothing can be told.

    Args:
        replies: Those to `host_queries`, which hold the first reading.
    """
    files = next((reply.out for probe, reply in zip(PROBES, replies, strict=False) if probe.name == "files"), "")
    found = _UPTIME.search(files)
    return counters(int(found[1]) * 100 + int(found[2]) if found else 0)


def docker_arch(machine: str) -> str:
    """Return Docker's name for what `uname -m` or the engine calls a machine; unknown ones stay, in lower case."""
    name = machine.lower()
    return _ARCHITECTURES.get(name, name if re.fullmatch(r"[a-z0-9_-]{1,20}", name) else "")


def parse_host(
    host: Host, replies: Sequence[Reply], measures: Measures | None, *, now: float | None = None,
    later: Reply | None = None,
) -> HostFacts:  # fmt: skip
    """Read the replies to `host_queries`, in its order; what a robot did not say properly keeps the model's default.

    What the inventory says of `host` wins or comes on top, and what psutil says of the controller itself (`measures`)
    wins over /proc. `now` is the controller's clock when the queries were sent, in seconds since the epoch. With
    `later`, the reply to `later_query` some time after the others, the traffic is known.
    """
    said = _read(replies)
    identity: OsIdentity = said["identity"]
    files: Files = said["files"]
    arch = _arch(identity)
    links = (*with_speeds(said["links"], files, said["wireless"], measures), *said["hidden"])
    underlay = find_underlay(host, links, said["routes"], identity.reached_at)
    devices = said["devices"]
    facts = HostFacts(
        name=host.name,
        arch=arch,
        emulates=_emulated(files, arch),
        **_words(files, said["wireguard"], said["processor"], said["rules"]),
        tags=tuple(detect_tags(devices, files, links, tuple(said["wireless"]), arch)),
        devices=(*devices.known, *devices.aliases),
        **_engine(replies, said["disk"]),
        links=links,
        routes=said["routes"].destinations,
        relies_on=lifelines(files, identity.client, said["routes"].gateways),
        underlay_link=underlay.link,
        underlay_address=underlay.address,
        underlay_mtu=underlay.mtu,
        speed_mbit=next((link.speed_mbit for link in links if link.name == underlay.link), 0.0),
        traffic_mbit=traffic_mbit(files, later, underlay.link, underlay.link in said["wireless"]),
        slots=host.slots if host.slots is not None else 1,
        clock_offset_s=round(identity.clock_s - now, 3) if now is not None and identity.clock_s is not None else 0.0,
        user=identity.user or host.user or "",
        privileged=identity.uid == 0,
        **amounts(files, said["cpus"], measures),
    )
    return with_inventory(host, facts)


def with_closer(facts: HostFacts, replies: Sequence[Reply], later: Reply | None) -> HostFacts:
    """Return what `parse_host` would, of a robot whose other replies it has read already.

    Args:
        facts: What it gave for the replies before there were `INFO`'s and `later`.
        replies: All of them, with `INFO`'s if that was asked.
        later: As `parse_host` has it.
    """
    said = _read(replies, ("files", "disk", "wireless"))
    link = facts.underlay_link
    traffic = traffic_mbit(said["files"], later, link, link in said["wireless"])
    return replace(facts, **_engine(replies, said["disk"]), traffic_mbit=traffic)


def with_inventory(host: Host, facts: HostFacts) -> HostFacts:
    """Put the inventory's word on top of facts: its tags and devices are added, its bandwidth wins."""
    return replace(
        facts,
        tags=tuple(sorted({*host.tags, *facts.tags})),
        devices=tuple(sorted({*host.devices, *facts.devices})),
        speed_mbit=host.bandwidth_mbit if host.bandwidth_mbit is not None else facts.speed_mbit,
    )


def _read(replies: Sequence[Reply], names: Collection[str] = ()) -> dict[str, Any]:
    """Return the value of each probe, or of those with these names; what a command said before it failed counts."""
    shell = replies[: len(PROBES)]
    outs = [shell[i].out if i < len(shell) else "" for i in range(len(PROBES))]
    asked = zip(PROBES, outs, strict=True)
    return {probe.name: probe.parse(out) for probe, out in asked if not names or probe.name in names}


def _engine(replies: Sequence[Reply], disk: Disks) -> dict[str, Any]:
    """Return what the engine says, and how much room there is where it keeps its data."""
    docker, problem = read_engine(replies)
    room = engine_disk(disk.mounts, (docker.root if docker else "") or disk.root)
    return {"docker": docker, "docker_problem": problem, "disk_total": room.total, "disk_free": room.free}


def _emulated(files: Files, arch: str) -> tuple[str, ...]:
    """Return what emulators run; only one that the kernel keeps open (F) is there in a container too."""
    on = {path for path in EMULATORS if "enabled" in files.get(path, ())}
    kept = (path for path in on if any("F" in _flags(line) for line in files[path]))
    return tuple(sorted({EMULATORS[path] for path in kept} - {arch}))


def _flags(line: str) -> str:
    """Return the flags of an emulator; nothing for another line."""
    found = re.fullmatch("flags: ?([A-Z]{1,32})", line)
    return found[1] if found else ""


def _words(files: Files, wireguard: WireguardAnswer, processor: str, rules: str) -> dict[str, Any]:
    """Return facts that are a word or a line, and what the machine is."""
    return {
        **equipment(files, processor),
        **msgspec.structs.asdict(read_spelled(files)),
        "wireguard": wireguard.by,
        "wireguard_problem": wireguard.problem,
        "rules": rules,
        "hostname": _first_line(files, "/proc/sys/kernel/hostname"),
        "kernel": _first_line(files, "/proc/sys/kernel/osrelease"),
        "os": _os_name(files),
        "systemd": _first_line(files, "/proc/1/comm") == "systemd",
    }


def _first_line(files: Files, path: str) -> str:
    return text(files.get(path, ("",))[0])


def _os_name(files: Files) -> str:
    for path in ("/etc/os-release", "/usr/lib/os-release"):
        for line in files.get(path, ()):
            if line.startswith("PRETTY_NAME="):
                return text(line.partition("=")[2].strip().strip("\"'"))
    return ""


def _arch(identity: OsIdentity) -> str:
    """Return what containers run: on a 32-bit system with a 64-bit kernel, as Raspberry Pi OS has it, 32-bit ones."""
    half = _HALVES.get(identity.machine, "") if identity.bits == 32 else ""
    return docker_arch(half or identity.machine)
