"""WireGuard interfaces: what encrypts an instance's VXLAN between its robots.

The interface's private key is made on the robot, goes from `wg genkey` into the kernel (or into `wireguard-go`, where
the kernel has none), and is nowhere else: in no file, no command and no answer. A new key is a new interface: `…a` and
`…b` take turns, and the old one goes when every robot sends through the new one.

`wireguard-go` is the one process that srprov leaves running on a robot; it ends with its interface.
Source: wg(8), wireguard-go's README, ip-netns(8).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from srprov.definitions.containermodel import TUNNEL_PORTS
from srprov.modules.module import Module, Names
from srprov.modules.wireguard_state import ALIAS, LINK, QUERIES, check_addresses, links_of
from srprov.resource import Action, Change, Observed, State
from srprov.wire import AnyQuery, Command, Reply, Run, quote, sh

_SOCKETS = "/var/run/wireguard"
_LOOSE = {"address": "address", "port": "listen_port", "mtu": "mtu"}
"""Parameter -> key of the state."""


class WireguardParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a WireGuard interface; its name is its namespace's, then `a` or `b`."""

    instance: str
    address: str
    """The robot's own in the namespace, where its VXLAN comes from."""
    port: int
    """UDP, on the robot."""
    mtu: int

    def __post_init__(self) -> None:
        """Refuse (ParameterError) what is no IPv4 address."""
        check_addresses("address", self.address)


class WireguardModule(Module[WireguardParams]):
    """The module of kind `wireguard`."""

    kind = "wireguard"
    params = WireguardParams
    common = True
    on_overlay = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """List the namespaces of encrypted overlays, with what is in them."""
        return QUERIES

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return our interfaces."""
        return tuple(
            Observed(module="wireguard", name=name, instance=instance, state={**state, "instance": instance})
            for instance, name, state in links_of(replies)
        )

    def check(self, name: str, want: WireguardParams, found: State | None) -> Change | None:
        """Compare; one that is half made, or has lost its key with its process, is made anew."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=_made(name, want))
        if not found["inside"] or not found["public"] or found["instance"] != want.instance:
            cause = "it has no key" if found["inside"] else "it is half made"
            return Change(action=Action.REPLACE, cause=cause, before=found, commands=_made(name, want))
        differing = [one for one, key in _LOOSE.items() if found[key] != getattr(want, one)]
        causes = [f"{one} is {found[_LOOSE[one]] or 'not set'}, not {getattr(want, one)}" for one in differing]
        causes += [] if found["up"] else ["it is down"]
        if causes:
            commands = _mended(name, want, differing)
            return Change(action=Action.UPDATE, cause="; ".join(causes), before=found, commands=commands)
        return None

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Delete the interface, wait until its process is gone, and delete the namespace with its last interface."""
        name, netns = quote(found.name), quote(found.name[:-1])
        lines = [
            *_deleted(found.name),
            f"[ -e /run/netns/{netns} ] || exit 0",
            f"ip -n {netns} -o link show | grep -q ': srpw' || ip netns del {netns} || exit",
            f"! ip -n {netns} link show dev {name} >/dev/null 2>&1",
        ]
        return (Run(script="\n".join(lines)),)

    def removed_after_making(self, other: str, *, here: bool) -> bool:
        """Stay until every robot sends through the new one, or its link does not go through any."""
        return other in ("wireguard_routes", "vxlan")

    def is_own(self, name: str, want: WireguardParams, names: Names) -> bool:
        """Compare names."""
        own = bool(LINK.fullmatch(name)) and (name[:-1], want.instance) == (names.tunnel, names.instance)
        return own and want.port in TUNNEL_PORTS["ab".index(name[-1]) :: 2]

    def misplaced(self, name: str, want: WireguardParams, context: Mapping[str, Any]) -> tuple[str, str] | None:
        """Say so of a name that would not be found again."""
        if wrong := super().misplaced(name, want, context):
            return wrong
        if not LINK.fullmatch(name):
            return f"'{name}' is no name of an interface of an overlay", "srprov's own playbook states it"
        return None


def _deleted(name: str) -> list[str]:
    """Return lines that delete an interface, wherever it is, and wait for the end of the process that it may have."""
    socket = quote(f"{_SOCKETS}/{name}.sock")
    return [
        f"if {sh('ip', '-n', name[:-1], 'link', 'del', 'dev', name)} 2>/dev/null ||"
        f" {sh('ip', 'link', 'del', 'dev', name)} 2>/dev/null; then",
        f"  n=0; while [ -S {socket} ] && [ $n -lt 50 ]; do sleep 0.1; n=$((n + 1)); done",
        "fi",
        f"rm -f {socket}; rmdir {_SOCKETS} 2>/dev/null",
    ]


def _made(name: str, want: WireguardParams) -> tuple[Command, ...]:
    """Return the script that makes the interface in the robot's own network, and moves it."""
    link, netns, alias = quote(name), quote(name[:-1]), quote(ALIAS + want.instance)
    # the process must outlive this session: it has its own, and nothing of the session's environment
    userspace = f'env -i PATH="$PATH" setsid wireguard-go {link} </dev/null >/dev/null'
    listening = f"grep -qs ':{want.port:04X} 0*:0000 ' /proc/net/udp /proc/net/udp6"
    lines = [
        *_deleted(name),
        f"! {listening} || {{ echo 'UDP port {want.port:d} is taken on this robot' >&2; exit 1; }}",
        f"ip link add dev {link} type wireguard 2>/dev/null || {userspace} || exit",
        f"ip link set dev {link} alias {alias} || exit",
        f"wg genkey | wg set {link} private-key /dev/stdin listen-port {want.port:d} || exit",
        # told while it is here: a process sees no more of its MTU once it is in the namespace
        f"ip link set dev {link} mtu {want.mtu:d} || exit",
        f"[ -e /run/netns/{netns} ] || ip netns add {netns} || exit",
        f"ip -n {netns} link set dev lo alias {alias} up || exit",
        f"{_in(name[:-1], _NO_FILTER)} || exit",
        f"ip link set dev {link} netns {netns} || exit",
        *_addressed(name, want),
        f"ip -n {netns} link set dev {link} up || exit",
        # a process looks every second whether its interface is up by now; what reaches the robot before that is lost
        f"n=0; until {listening} || [ $n -ge 50 ]; do sleep 0.1; n=$((n + 1)); done",
        f"{listening} || {{ echo 'it does not listen on UDP port {want.port:d}' >&2; exit 1; }}",
    ]
    return (Run(script="\n".join(lines)),)


# while keys change, packets come in through another interface than they go out through
_NO_FILTER = (
    "for f in all default; do f=/proc/sys/net/ipv4/conf/$f/rp_filter; "
    'read -r v <$f; [ "$v" = 0 ] || echo 0 >$f || exit; done'
)


def _in(netns: str, script: str) -> str:
    return sh("ip", "netns", "exec", netns, "sh", "-c", script)


def _addressed(name: str, want: WireguardParams) -> list[str]:
    netns, address = quote(name[:-1]), quote(f"{want.address}/32")
    # routes that packets have it as source of go with an address, even for a moment
    return [
        f"if ! ip -n {netns} -o addr show dev lo | grep -qF {quote(f' {want.address}/32 ')}; then",
        f"  ip -n {netns} addr flush dev lo scope global && ip -n {netns} addr add {address} dev lo || exit",
        "fi",
    ]


def _mended(name: str, want: WireguardParams, differing: Sequence[str]) -> tuple[Command, ...]:
    """Return the script that sets what differs."""
    link, netns = quote(name), quote(name[:-1])
    lines = _addressed(name, want) if "address" in differing else []
    if "port" in differing:
        lines.append(f"ip netns exec {netns} wg set {link} listen-port {want.port:d} || exit")
    lines.append(f"ip -n {netns} link set dev {link} mtu {want.mtu:d} up")
    return (Run(script="\n".join(lines)),)
