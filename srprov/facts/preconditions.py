"""What a robot must have for srprov to work, each with its remedy.

Takes a robot's facts and the replies to a few more questions; gives checks. Pure. A check that cannot be decided
from outside says so instead of guessing. `srprov doctor` shows them.

Source: what the commands of `modules/` and the scripts of `transport/` and `execution/` call.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence

import msgspec
from msgspec.structs import replace

from srprov.container_files import is_mended
from srprov.facts.every_link import EVERY_LINK, every_link
from srprov.facts.model import HostFacts
from srprov.facts.runc import REMEDY, RUNC, runc
from srprov.time_sync import TimeSync
from srprov.untrusted import lines_of
from srprov.wire import AnyQuery, Query, Reply

_TOOLS = {
    "ip": "iproute2",
    "bridge": "iproute2",
    "tar": "tar",
    "base64": "coreutils",
    "sha256sum": "coreutils",
    "find": "findutils",
    "timeout": "coreutils",
    "flock": "util-linux",
}
"""Program -> Debian package."""
_WIREGUARD = {"kernel": "in the kernel", "userspace": "wireguard-go"}
_API = (1, 41)
_UPDATE = (
    "a container can become root on its robot while anybody copies its files, or those of its volumes, by Docker's own "
    "`cp` (CVE-2026-42306, CVE-2026-41568, CVE-2026-41567); `srprov cp` goes around it. Update Docker Engine to 29.5.1 "
    "or newer, unless your distribution has mended them in this one"
)
_DISK_MIB = 1024
_CLOCK_S = 1.0
_MTU = 1280


class Verdict(enum.Enum):
    """What came of a check."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """One precondition of one robot."""

    name: str
    verdict: Verdict
    found: str
    """What is there, in words."""
    remedy: str = ""
    """What to do; empty when it is right."""
    is_common: bool = False
    """It is so on most robots there are: told once, for all of them."""


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """A robot's clock, measured by several round trips."""

    offset_s: float | None
    """From the controller's; None when it gives no time."""
    error_s: float
    """The truth lies within so much of it."""
    kept_by: TimeSync | None
    """None: by nothing that is known."""


def precondition_queries() -> tuple[AnyQuery, ...]:
    """Return the questions that facts do not answer; they only read."""
    programs = " ".join(_TOOLS)
    return (
        Query(command=f"for p in {programs}; do command -v $p >/dev/null 2>&1 || echo $p; done"),
        Query(
            command="test -d /sys/module/vxlan && echo loaded && exit; "
            "grep -qs '/vxlan[.]ko' /lib/modules/$(uname -r)/modules.builtin && echo builtin && exit; "
            "modprobe -n -q vxlan 2>/dev/null && echo loadable && exit; "
            "ls /sys/class/net/*/type >/dev/null 2>&1; echo unknown"
        ),
        Query(command="cat /proc/sys/net/ipv4/ip_forward"),
        Query(command="ip -j link show lo"),
        Query(
            command="nft list tables >/dev/null 2>&1 && echo nftables && exit; "
            "iptables -V >/dev/null 2>&1 && echo iptables && exit; echo none"
        ),
        RUNC,
        EVERY_LINK,
    )


def judge(facts: HostFacts, replies: Sequence[Reply], clock: Clock) -> tuple[Check, ...]:
    """Return all checks of one robot, in a fixed order.

    Args:
        facts: the robot as it is.
        replies: to `precondition_queries`, in its order.
        clock: its clock, as measured.
    """
    programs, vxlan, forwarding, as_json, rules, version, asking = replies
    return (
        _rights(facts),
        *_programs(programs, as_json),
        _engine(facts),
        _check("runc", *runc(version), REMEDY, Verdict.WARNING),
        _copies(facts),
        *_network(facts, vxlan, forwarding),
        _rules(rules),
        *(_check(*judged, Verdict.WARNING) for judged in every_link(asking, facts)),
        _wireguard(facts),
        _disk(facts),
        _clock(clock),
    )


def _check(name: str, right: bool, found: str, remedy: str, otherwise: Verdict = Verdict.FAILED) -> Check:
    return Check(name=name, verdict=Verdict.OK if right else otherwise, found=found, remedy="" if right else remedy)


def _rights(facts: HostFacts) -> Check:
    found = f"{facts.user or 'user'} {'has' if facts.privileged else 'has no'} root's rights"
    return _check("root", facts.privileged, found, "allow `sudo -n sh` for that user, or log in as root")


def _programs(programs: Reply, as_json: Reply) -> Iterator[Check]:
    missing = [name for name in lines_of(programs.out, len(_TOOLS)) if name in _TOOLS]
    packages = " ".join(sorted({_TOOLS[name] for name in missing}))
    found = f"missing: {', '.join(missing)}" if missing else "all there"
    yield _check("programs", not missing, found, f"apt-get install {packages}")
    speaks = as_json.ok and as_json.out.lstrip().startswith("[")
    found = "speaks JSON" if speaks else "`ip -j` does not answer in JSON"
    yield _check("iproute2", speaks, found, "install iproute2 5.0 or newer")


def _engine(facts: HostFacts) -> Check:
    docker = facts.docker
    if docker is None:
        problem = facts.docker_problem or "no answer"
        return _check("docker", False, problem, "install and start Docker: apt-get install docker.io")
    version = tuple(int(part) if part.isdecimal() else 0 for part in docker.api_version.split("."))
    if docker.rootless:
        remedy = "run a rootful engine: a rootless one cannot join a bridge of the host to a VXLAN link"
        return _check("docker", False, f"{docker.version}, rootless", remedy)
    wanted = ".".join(map(str, _API))
    remedy = f"update Docker to 20.10 or newer (API {wanted})"
    return _check("docker", version >= _API, f"{docker.version}, API {docker.api_version}", remedy)


def _copies(facts: HostFacts) -> Check:
    version = facts.docker.version if facts.docker else ""
    right = not facts.docker or is_mended(version)
    return replace(_check("copies", right, version or "no engine", _UPDATE, Verdict.WARNING), is_common=True)


def _network(facts: HostFacts, vxlan: Reply, forwarding: Reply) -> Iterator[Check]:
    state = vxlan.out.strip()
    remedy = "load the module `vxlan`; on Ubuntu for Raspberry Pi it is in linux-modules-extra-raspi"
    known = state in ("loaded", "builtin", "loadable")
    yield _check("vxlan", known, state if known else "cannot tell", remedy, Verdict.WARNING)
    remedy = "set srprov_underlay in the inventory to the interface or address that other robots reach"
    yield _check("underlay", bool(facts.underlay_address), facts.underlay_address or "no address", remedy)
    found = f"{facts.underlay_mtu} bytes on {facts.underlay_link or 'the underlay'}"
    yield _check("mtu", facts.underlay_mtu >= _MTU, found, f"raise it to at least {_MTU}", Verdict.WARNING)
    on = forwarding.out.strip() == "1"
    remedy = "echo 1 > /proc/sys/net/ipv4/ip_forward (Docker does it when it starts)"
    yield _check("forwarding", on, "on" if on else "off", remedy, Verdict.WARNING)


def _rules(rules: Reply) -> Check:
    by = rules.out.strip()
    found = by if by in ("nftables", "iptables") else "neither nft nor iptables works"
    return _check("rules", found == by, found, "apt-get install nftables: rules keep others out of overlays")


def _wireguard(facts: HostFacts) -> Check:
    found = _WIREGUARD.get(facts.wireguard, facts.wireguard_problem or "cannot tell")
    remedy = "apt-get install wireguard-tools wireguard-go; only experiments with network.encryption need it"
    return _check("wireguard", bool(facts.wireguard), found, remedy, Verdict.WARNING)


def _disk(facts: HostFacts) -> Check:
    free = facts.disk_free // 2**20
    remedy = "make room: docker system prune, or a larger disk for Docker's root"
    return _check("disk", free >= _DISK_MIB, f"{free} MiB free for Docker", remedy, Verdict.WARNING)


def _clock(clock: Clock) -> Check:
    kept = clock.kept_by
    remedy = "set the clock: apt-get install chrony; robots whose clocks differ cannot share transforms"
    if clock.offset_s is None:
        return _check("clock", False, "it gives no time", remedy, Verdict.WARNING)
    off = f"{1000 * clock.offset_s:+.1f} ms" if abs(clock.offset_s) < 1 else f"{clock.offset_s:+.2f} s"
    found = f"{off} (+-{1000 * clock.error_s:.1f} ms) from the controller"
    found += f"; {kept.in_words}" if kept else "; nothing known keeps it"
    if kept and not kept.synchronised:
        remedy = f"give {kept.daemon} a time server that this robot reaches"
    right = abs(clock.offset_s) - clock.error_s <= _CLOCK_S and (kept is None or kept.synchronised)
    return _check("clock", right, found, remedy, Verdict.WARNING)
