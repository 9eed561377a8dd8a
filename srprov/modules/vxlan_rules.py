"""The rules that close an overlay, as scripts for nftables, or for iptables where nft does not work. Pure.

With nftables, what is let in is marked with its VNI, and what comes out of the VXLAN link without that mark is dropped.
So a packet that hides what it is from the rules (in a header that they do not read, or behind the first segment of a
large one, which may be let in for another instance) is dropped too. iptables cannot see what comes out of the link, so
there what must not come in is dropped by name.

Of a packet that a robot lets in, the source port says that the kernel or root sent it: links send from `SOURCE_PORTS`
(`vxlan.py`), which other users of a robot cannot take. Packets from such ports that only pass through a robot, as from
its containers, do not reach another robot of the instance: there they would have the first one's address. And what is
sent to another address of the robot's than the VTEP is dropped: containers reach it as their gateway, through a bridge
that it is on, with whatever address they say is theirs.

What members send is not tracked: a container that sends from the overlay's port to a member's is given the robot's
address and that very port, where they are free, and would be handed the answers, which is what that member sends.

Source: nft(8), iptables-extensions(8); RFC 7348: a VXLAN header has the VNI in its bytes 4 to 6, after UDP's 8.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import msgspec

from srprov.definitions.containermodel import LINK_PORTS
from srprov.modules.module import digest
from srprov.wire import printed, quote

SOURCE_PORTS = (LINK_PORTS[0], LINK_PORTS[-1])
"""First and last: privileged ones, above those that services have."""
MARK = 0x53000000
"""A packet that was let in has this and the VNI as its mark, until the bridge; one for all would let a member of any
instance into each of them."""
NFTABLES, IPTABLES = "nftables", "iptables"
_FAILED = "the overlay cannot be closed: neither nft nor iptables works here; apt-get install nftables"


class Filter(msgspec.Struct, frozen=True, kw_only=True):
    """What the rules of one instance on one robot say."""

    name: str
    """Of the VXLAN link; tables and chains are called the same."""
    label: str
    """The beginning of each rule's comment."""
    hash: str
    vni: int
    port: int
    local: str
    """The robot's own VTEP, the one address of its that members send to."""
    peers: Sequence[str]
    six: bool
    """IPv6."""


def closing(rules: Filter, by: Collection[str]) -> str:
    """Return the script that makes the rules, or replaces those that are there at once, without a gap.

    Args:
        rules: What they say.
        by: Which program has rules of this filter already.
    """
    name = quote(rules.name)
    family, other = ("ip6", "ip") if rules.six else ("ip", "ip6")
    after, rest = (
        (f"{_remove_iptables(name, 'ip ip6')}\n", f"\n{_remove_iptables(name, other)}") if IPTABLES in by else ("", "")
    )
    return (
        f"if {printed(_nft_removed(rules.name) + _nft(rules))} | nft -f - 2>/dev/null\nthen\n{after}exit\nfi\n"
        f"{_restore(family, name, _iptables(rules))} || {{ echo {quote(_FAILED)} >&2; exit 1; }}{rest}"
    )


def opening(name: str, by: Collection[str]) -> str:
    """Return the script that takes all rules of a filter away; it also succeeds where there are none."""
    parts = [f"{printed(_nft_removed(name))} | nft -f - || exit"] if NFTABLES in by else []
    return "\n".join([*parts, *([_remove_iptables(quote(name), "ip ip6")] if IPTABLES in by else [])])


def rules_hash(vni: int, port: int, local: str, peers: Collection[str]) -> str:
    """Return the name of what rules say, which the comment of each has."""
    return digest([vni, port, local, sorted({*peers} - {local}), MARK, "untracked"], 8)


def closed_first(name: str, wanted: str) -> str:
    """Return a line that ends a script where no rule of a filter is there; a table alone drops nothing.

    A link may be made in one round trip with them, and must not come up when they failed. Those of another port or VNI,
    or for other robots, close another overlay than that of the link: `wanted` is the hash of its own.
    """
    link = quote(name)
    ways = (f"nft list table bridge {link}", *(f"{f}tables -t raw -n -L {link}-in" for f in ("ip", "ip6")))
    return (
        f"case $({{ {' || '.join(ways)}; }} 2>/dev/null) in *:{wanted}:*) ;; "
        f"*) echo {quote('no rules close the overlay')} >&2; exit 1 ;; esac"
    )


def _nft_removed(name: str) -> str:
    # a table is made first, since what is not there cannot be deleted
    return "".join(f"table {family} {name}\ndelete table {family} {name}\n" for family in ("inet", "bridge"))


def _nft(rules: Filter) -> str:
    low, high = SOURCE_PORTS
    ip, peers = "ip6" if rules.six else "ip", f"{{ {', '.join(rules.peers)} }}"
    through = f"udp sport < 1024 udp dport {rules.port} {ip} daddr {peers}"
    who = f"{ip} daddr {rules.local} {ip} saddr {peers}"
    ours = f"udp sport {low}-{high} udp dport {rules.port} @th,96,24 {rules.vni} {who}"
    mark = f"{MARK | rules.vni:#x}"
    let_in = f"counter meta mark set {mark}"
    out = f'iifname "{rules.name}"'
    chains = [
        ("inet", "through", "forward priority -300", [
            f"{through} {ip} saddr != {peers} counter drop",
            f"{through} fib saddr . iif oif missing counter drop",
        ] if rules.peers else []),
        # after all others, so that nobody else sets the mark in between
        ("inet", "arriving", "input priority 300", [
            f"{ours} fib daddr . iif type local {let_in}",
            f"{ours} fib saddr . iif oif exists {let_in}",
        ] if rules.peers else []),
        ("bridge", "unpacked", "prerouting priority -300", [
            f"{out} meta mark != {mark} counter drop",
            f"{out} meta mark set 0x0",
        ]),
        ("inet", "untracked", "prerouting priority -300", [f"{ours} counter notrack"] if rules.peers else []),
    ]  # fmt: skip
    label = _labels(rules, sum(len(lines) for *_, lines in chains))
    text = ""
    for family, chain, hook, lines in chains:
        body = "".join(f'    {line} comment "{label()}"\n' for line in lines)
        text += f"table {family} {rules.name} {{\n  chain {chain} {{\n    type filter hook {hook}; policy accept;\n"
        text += f"{body}  }}\n}}\n"
    return text


def _iptables(rules: Filter) -> str:
    ours, through = f"{rules.name}-in", f"{rules.name}-via"
    to = f"-p udp -m udp --dport {rules.port}"
    vni = f"4>>8&0xFF=17&&52>>8={rules.vni}" if rules.six else f"0>>22&0x3C@12>>8={rules.vni}"
    low, high = SOURCE_PORTS
    lines = [
        (f"-I PREROUTING {to} -m u32 --u32 {vni}", ours),
        # of a packet with more headers than these two the VNI is not where it is looked for
        *([(f'-I PREROUTING {to} -m u32 ! --u32 "4>>8&0xFF=17"', ours)] if rules.six else []),
        (f"-I PREROUTING {to} --sport 0:1023", through),
        # a rule that asks for connections has the kernel put fragments together before it
        (f"-A {ours} -m conntrack --ctstate INVALID", ""),
        (f"-A {ours} -p udp -m udp ! --sport {low}:{high}", "DROP"),
        (f"-A {ours} -m addrtype ! --dst-type LOCAL --limit-iface-in -m rpfilter --invert", "DROP"),
        (f"-A {ours}", "CT --notrack"),
        *((f"-A {ours} -s {peer} -d {rules.local}", "RETURN") for peer in rules.peers),
        (f"-A {ours}", "DROP"),
        *((f"-A {through} -s {peer} -m rpfilter", "RETURN") for peer in rules.peers),
        *((f"-A {through} -d {peer}", "DROP") for peer in rules.peers),
    ]
    label = _labels(rules, len(lines))
    ends = [f" -j {target}" if target else "" for _, target in lines]
    return "".join(f"{line} -m comment --comment {label()}{end}\n" for (line, _), end in zip(lines, ends, strict=True))


def _restore(family: str, name: str, lines: str) -> str:
    """Return a pipe that replaces our chains, and the rules that lead to them, at once.

    A chain that is declared is made, or emptied; the rules that lead there are those that are there, with -D for -A.
    """
    tables = f"{family}tables"
    jumps = f"{tables}-save -t raw 2>/dev/null | sed -n '/ -j '{name}'-/s/^-A PREROUTING/-D PREROUTING/p'"
    chains = printed(f":{name}-in - [0:0]\n:{name}-via - [0:0]\n{lines}COMMIT\n")
    return f"{{ echo '*raw'; {jumps}\n{chains}; }} | {tables}-restore -n -w 5"


def _remove_iptables(name: str, families: str) -> str:
    there = f'"$f"tables-save -t raw 2>/dev/null | grep -q -e "^:"{name}-'
    restore = _restore('"$f"', name, f"-X {name}-in\n-X {name}-via\n")
    return f"for f in {families}; do\nif {there}; then\n{restore} || exit\nfi\ndone"


def _labels(rules: Filter, count: int) -> Callable[[], str]:
    numbers = iter(range(1, count + 1))
    return lambda: f"{rules.label}:{next(numbers)}/{count}"
