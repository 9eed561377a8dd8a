"""VXLAN filters: who may send into an instance's overlay on one robot.

Only the instance's other robots may: with their underlay address, by an interface that leads to them, and from a source
port that only root can take. The rules name the instance's UDP port and VNI, so VXLANs of others on the same port are
let alone, and they stand in tables or chains of their own. `vxlan_rules.py` has their text.

Each rule's comment says its instance, the filter's name, a hash of what was wanted, and its number of how many. That is
what is read back: how a rule is printed differs from version to version.

Source: nft(8), iptables-extensions(8).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from ipaddress import ip_address
from typing import Any

import msgspec

from srprov.modules.module import Module, Names
from srprov.modules.params import ParameterError
from srprov.modules.vxlan_rules import IPTABLES, NFTABLES, Filter, closing, opening, rules_hash
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import lines_of
from srprov.wire import AnyQuery, Command, Query, Reply, Run, sh

_INSTANCE = re.compile(r"[a-z0-9-]{1,32}")
_COMMENT = re.compile(
    rf"srprov:({_INSTANCE.pattern}):(srpv[0-9a-f]{{8}}):([0-9a-f]{{8}}):([0-9]{{1,4}})/([0-9]{{1,4}})"
)
_NAME = re.compile("srpv[0-9a-f]{8}")
_MADE = re.compile(r"(?:table (?:inet|bridge) |:)(srpv[0-9a-f]{8})(?: \{|-in |-via )")
"""The beginning of a table or chain of ours."""
_ACCEPTS_ALL = re.compile(r"-A PREROUTING(?: -m comment --comment \S+)? -j ACCEPT")
_LINES = 100_000
# nft tells in one go what is there, also tables that iptables made over it, and takes as long for all as for one; it
# looks up names of ports and protocols unless it is told not to. The
# old iptables would load its module when it is asked for a table, so the kernel is asked first whether that is there.
_LIST = (
    """\
t=$(nft -s -n list ruleset 2>/dev/null) || t=none
case $t in none) ;; *" srpv"*) printf '%s\\n' "$t" ;; esac
"""
    + "".join(
        f"""\
v=
case $t in none) v=$({ip}tables -V 2>/dev/null) ;; *"table {ip} raw"*) v=nf_tables ;; esac
case $v in
  *nf_tables*) ;;
  *) v= ; while read -r n; do [ "$n" != raw ] || v=legacy; done 2>/dev/null </proc/net/{ip}_tables_names ;;
esac
[ -z "$v" ] || {ip}tables-save -t raw 2>/dev/null | grep -e srprov: -e '^[*:]' -e '^-A PREROUTING.* -j ACCEPT'
"""
        for ip in ("ip", "ip6")
    )
    + ":"
)


class VxlanFilterParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a filter."""

    instance: str
    vni: int
    port: int
    local: str
    """The robot's own VTEP."""
    peers: tuple[str, ...]
    """The VTEPs that may send: those of all other robots of the instance."""

    @property
    def vteps(self) -> tuple[str, ...]:
        """The robots of the instance, as far as it says."""
        return (self.local, *self.peers)

    def __post_init__(self) -> None:
        """Take only what can stand in a rule as it is."""
        for name, value, most in (("vni", self.vni, 2**24 - 1), ("port", self.port, 65535)):
            if not 1 <= value <= most:
                raise ParameterError(name, f"{name} {value} is not in 1..{most}")
        if len({_version("local", self.local), *(_version("peers", one) for one in self.peers)}) > 1:
            raise ParameterError("peers", "local and peers are not of one IP version")


class VxlanFilterModule(Module[VxlanFilterParams]):
    """The module of kind `vxlan_filter`."""

    kind = "vxlan_filter"
    params = VxlanFilterParams
    common = True
    on_overlay = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List our rules, of nftables and of iptables."""
        return (Query(command=_LIST, in_place=True),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Count the rules of each filter by their comments; tables and chains without a rule are one that has none."""
        seen: dict[str, dict[str, _Seen]] = {}
        made: set[tuple[str, str]] = set()
        accepts, table = False, ""
        for line in lines_of(replies[0].out, _LINES):
            by = IPTABLES if line.startswith(("-A ", ":")) else NFTABLES
            accepts = not line.startswith("*") and (accepts or bool(_ACCEPTS_ALL.fullmatch(line.strip())))
            if match := _MADE.match(line):
                made.add((match[1], by))
            if line.startswith("table "):
                table = match[1] if match else ""
            # a rule of somebody else's table may say anything
            if (match := _COMMENT.search(line)) and (by == IPTABLES or match[2] == table):
                one = seen.setdefault(match[2], {}).setdefault(by, _Seen(match[1], match[3], int(match[5]), accepts))
                one.add(match[3], int(match[4]))
        for name, by in sorted(made):
            seen.setdefault(name, {}).setdefault(by, _Seen("", "", 0, False))
        return tuple(_observed(name, sides) for name, sides in seen.items())

    def check(self, name: str, want: VxlanFilterParams, found: State | None) -> Change | None:
        """Compare the hash, and count."""
        if not _NAME.fullmatch(name):
            refuse = Run(script=sh("echo", f"{name} cannot be the name of a VXLAN filter") + " >&2; exit 1")
            return Change(action=Action.CREATE, cause="not there", commands=(refuse,))
        rules = _filter(name, want)
        if found is None:
            cause = "not there: any host could send into the overlay"
            return Change(action=Action.CREATE, cause=cause, commands=_commands(rules, ()))
        causes = []
        if not found["of"]:
            causes.append("its rules are gone: any host can send into the overlay")
        elif found["instance"] != want.instance or found["hash"] != rules.hash:
            causes.append("made for other robots, another port or VNI")
        elif found["rules"] != found["of"]:
            causes.append(f"{found['of'] - found['rules']} of {found['of']} rules are gone")
        if found["passed"]:
            causes.append("a rule of iptables before it accepts all packets")
        if len(found["by"]) > 1:
            causes.append("rules are both in nftables and in iptables")
        if not causes:
            return None
        commands = _commands(rules, found["by"])
        return Change(action=Action.UPDATE, cause="; ".join(causes), before=found, commands=commands)

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Take the rules away where they are."""
        return (Run(script=opening(found.name, found.state["by"])),)

    def removed_after_making(self, other: str, *, here: bool) -> bool:
        """Stay until the link is one that needs no rules: of an overlay that is encrypted from now on."""
        return here and other == "vxlan"

    def is_own(self, name: str, want: VxlanFilterParams, names: Names) -> bool:
        """Compare names, and whom it lets in: robots of the plan."""
        return (name, want.instance) == (names.link, names.instance) and {*want.vteps} <= names.vteps


class _Seen:
    """The rules of one filter in one of the two programs."""

    def __init__(self, instance: str, text: str, count: int, passed: bool) -> None:
        self.instance, self.hash, self.count, self.passed = instance, text, count, passed
        self.numbers: set[int] = set()

    def add(self, text: str, number: int) -> None:
        """Count a rule; one of another making is none."""
        if text == self.hash and 1 <= number <= self.count:
            self.numbers.add(number)


def _observed(name: str, sides: dict[str, _Seen]) -> Observed:
    one = max(sides.values(), key=lambda side: (side.count > 0, side is sides.get(NFTABLES)))
    state: dict[str, Any] = {
        "instance": one.instance,
        "hash": one.hash,
        "rules": len(one.numbers),
        "of": one.count,
        "by": sorted(sides),
        "passed": one.passed,
    }
    return Observed(module="vxlan_filter", name=name, instance=one.instance, state=state)


def closing_script(name: str, want: VxlanFilterParams) -> str:
    """Return the script that makes the rules of a filter which is not there."""
    return closing(_filter(name, want), ())


def _filter(name: str, want: VxlanFilterParams) -> Filter:
    peers = tuple(sorted({*want.peers} - {want.local}))
    text = rules_hash(want.vni, want.port, want.local, peers)
    # no instance has another name; one that had would never find its rules again, and not be quoted wrongly either
    owner = want.instance if _INSTANCE.fullmatch(want.instance) else "-"
    mark = f"srprov:{owner}:{name}:{text}"
    six = ip_address(want.local).version == 6
    return Filter(
        name=name, label=mark, hash=text, vni=want.vni, port=want.port, local=want.local, peers=peers, six=six
    )


def _commands(rules: Filter, by: Sequence[str]) -> tuple[Command, ...]:
    return (Run(script=closing(rules, by)),)


def _version(parameter: str, text: str) -> int:
    try:
        found = ip_address(text)
    except ValueError as error:
        raise ParameterError(parameter, f"{text!r} is no IP address") from error
    if "%" in text:
        raise ParameterError(parameter, f"{text!r} has a scope")
    return found.version
