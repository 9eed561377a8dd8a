"""Who a WireGuard interface speaks with: the other members of its instance, each allowed its own address alone.

A playbook names robots. Their public keys are what they themselves say, when the plan is made or in the course of the
run that makes them, so that no plan file can name the key of a stranger. The name is the interface's.
Source: wg(8).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from ipaddress import ip_address
from typing import Annotated, Any

import msgspec
from msgspec.structs import replace

from srprov.definitions.containermodel import TUNNEL_PORTS
from srprov.modules.module import Module, Names
from srprov.modules.params import NOT_WRITTEN, ParameterError
from srprov.modules.wireguard_state import LINK, QUERIES, Interface, check_addresses, read
from srprov.resource import Action, Change, Observed, State
from srprov.wire import AnyQuery, Command, Reply, Run, sh

_PORT = re.compile(r":([0-9]{1,5})\Z", re.ASCII)
_Peer = tuple[str, str]
"""Endpoint and address."""


class WireguardPeersParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of an interface's peers."""

    instance: str
    peers: tuple[tuple[str, str, str], ...]
    """Robot, its underlay address and port, and its address in the namespace."""
    keys: Annotated[Mapping[str, str], NOT_WRITTEN] = msgspec.field(default_factory=dict)
    """Robot in reach -> its public key; empty where it has none yet, words where it is this robot's too.
    Added by `informed`."""

    def __post_init__(self) -> None:
        """Refuse (ParameterError) addresses that are none, or several: each peer has its own alone."""
        check_addresses("peers", *(address for _, _, address in self.peers))
        for _, endpoint, _ in self.peers:
            if not _is_endpoint(endpoint):
                raise ParameterError("peers", f"'{endpoint[:60]}' is no IP address with a port")

    @property
    def vteps(self) -> tuple[str, ...]:
        """The robots that it speaks with, by their underlay addresses."""
        return tuple(host_of(endpoint) for _, endpoint, _ in self.peers)


class WireguardPeersModule(Module[WireguardPeersParams]):
    """The module of kind `wireguard_peers`."""

    kind = "wireguard_peers"
    params = WireguardPeersParams
    common = True
    on_overlay = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """Ask what `wireguard` asks."""
        return QUERIES

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return the peers of each interface; they go with it, so nobody owns them."""
        return tuple(
            Observed(module="wireguard_peers", name=name, instance="", state=_state(link))
            for one in read(replies)
            for name, link in sorted(one.interfaces.items())
        )

    def informed(
        self, name: str, host: str, want: WireguardPeersParams, there: Mapping[str, Collection[Observed]]
    ) -> WireguardPeersParams:
        """Return them with the robots' public keys. Of several robots with one key, none is believed.

        Those cannot speak with each other, and say why; to the others they are out of reach.
        """
        said = {
            robot: str(one.state["public"])
            for robot, items in there.items()
            for one in items
            if (one.module, one.name) == ("wireguard", name)
        }
        robots = {robot for robot, _, _ in want.peers} & there.keys()
        keys = {**dict.fromkeys(robots, ""), **want.keys, **{one: said[one] for one in robots & said.keys()}}
        own = said.get(host, "")
        held = Counter(key for key in (*keys.values(), own) if key)
        claimed = {robot: _claimed(robot, host) for robot, key in keys.items() if key and key == own}
        keys = {robot: key for robot, key in keys.items() if held[key] <= 1 or robot in claimed}
        return replace(want, keys={**keys, **claimed})

    def check(self, name: str, want: WireguardPeersParams, found: State | None) -> Change | None:
        """Compare keys, endpoints and addresses. What is there for the address of a robot out of reach stays.

        So does the endpoint of a peer that is spoken with: WireGuard follows one that sends from another address.
        """
        there = {key: (endpoint, allowed) for key, endpoint, allowed in (found["peers"] if found else ())}
        lively = {key: there[key][1] for key in (found["status"] if found else ()) if key in there}
        away = {f"{address}/32" for robot, _, address in want.peers if robot not in want.keys}
        kept = {key for key, (_, allowed) in there.items() if allowed in away}
        wanted = _wanted(want, kept)
        gone = sorted(there.keys() - wanted.keys() - kept)
        due = sorted(key for key, peer in wanted.items() if there.get(key) != peer and lively.get(key) != peer[1])
        commands = _set(name, gone, {key: wanted[key] for key in due})
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=commands)
        if gone or due:
            cause = f"{len(due)} to add, {len(gone)} to remove"
            return Change(action=Action.UPDATE, cause=cause, before=found, commands=commands)
        return None

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Do nothing: they go with their interface."""
        return ()

    def is_own(self, name: str, want: WireguardPeersParams, names: Names) -> bool:
        """Compare names, and where packets go: to robots of the plan."""
        own = bool(LINK.fullmatch(name)) and (name[:-1], want.instance) == (names.tunnel, names.instance)
        return own and {*want.vteps} <= names.vteps


def host_of(endpoint: str) -> str:
    """Return the address of an endpoint such as `192.0.2.1:20000` or `[2001:db8::1]:20000`."""
    return endpoint.rpartition(":")[0].strip("[]")


def _is_endpoint(text: str) -> bool:
    try:
        ip_address(host_of(text))
    except ValueError:
        return False
    port = _PORT.search(text)
    return "%" not in text and port is not None and int(port[1]) in TUNNEL_PORTS


def _state(link: Interface) -> dict[str, Any]:
    """Return (key, endpoint, allowed) of each peer, sorted, what is not said empty; and who was heard of just now."""
    peers = sorted([key, *[*said, "", ""][:2]] for key, said in link.peers.items())
    return {"peers": peers, "status": sorted(link.lively)}


def _unknown(robot: str) -> str:
    """Return what stands for a key that is not known; `wg` takes it for none."""
    return f"<public key of {robot}>"


def _claimed(robot: str, host: str) -> str:
    """Return what stands for a key that both robots say is their own; `wg` takes it for none, and tells it."""
    return f"<one public key, which {robot} and {host} both say is theirs>"


def _anothers(robot: str) -> str:
    """Return what stands for a key that is that of another one, out of reach; `wg` takes it for none, and tells it."""
    return f"<public key of {robot}, which says one that is another robot's>"


def _wanted(want: WireguardPeersParams, kept: Collection[str]) -> dict[str, _Peer]:
    """Return key -> peer; a key that is kept for a robot out of reach is no other's."""
    found: dict[str, _Peer] = {}
    for robot, endpoint, address in want.peers:
        if robot in want.keys:
            key = want.keys[robot] or _unknown(robot)
            found[_anothers(robot) if key in kept else key] = endpoint, f"{address}/32"
    return found


def _set(name: str, gone: Sequence[str], due: Mapping[str, _Peer]) -> tuple[Command, ...]:
    """Return the script of one call of wg(8)."""
    words = ["ip", "netns", "exec", name[:-1], "wg", "set", name]
    for key in gone:
        words += ["peer", key, "remove"]
    for key, (endpoint, allowed) in due.items():
        words += ["peer", key, "endpoint", endpoint, "allowed-ips", allowed]
    return (Run(script=sh(*words) if gone or due else ":"),)
