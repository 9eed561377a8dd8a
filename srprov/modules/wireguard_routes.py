"""Which WireGuard interface of a namespace carries the overlay: the routes to the other members' addresses in there.

A robot is sent to through a new interface only when every robot has it, and knows all others' keys there; and when
the two have shaken hands. Of two that begin that at the same time neither hears the other, and both wait for five
seconds; so the one with the lower address begins. The name is the namespace's.
Source: ip-route(8), wg(8), the WireGuard paper, section 6.1 (Rekey-Timeout).
"""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import IPv4Address

import msgspec

from srprov.modules.ip_batch import batch
from srprov.modules.module import Module, Names
from srprov.modules.params import ParameterError
from srprov.modules.wireguard_state import LINK, QUERIES, check_addresses, read
from srprov.resource import Action, Change, Observed, State
from srprov.wire import AnyQuery, Command, Reply, Run, sh


class WireguardRoutesParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a namespace's routes."""

    instance: str
    interface: str
    address: str
    """The robot's own in the namespace."""
    to: tuple[str, ...]
    """The addresses of the other members."""

    def __post_init__(self) -> None:
        """Refuse (ParameterError) what is no interface of an overlay, and what are no IPv4 addresses."""
        if not LINK.fullmatch(self.interface):
            raise ParameterError("interface", f"'{self.interface}' is no name of an interface of an overlay")
        check_addresses("address", self.address)
        check_addresses("to", *self.to)


class WireguardRoutesModule(Module[WireguardRoutesParams]):
    """The module of kind `wireguard_routes`."""

    kind = "wireguard_routes"
    params = WireguardRoutesParams
    common = True
    on_overlay = True
    shares_round_trip = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """Ask what `wireguard` asks."""
        return QUERIES

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Return the routes of each namespace that has an interface; they go with it, so nobody owns them."""
        return tuple(
            Observed(module="wireguard_routes", name=one.name, instance="", state={"through": dict(one.through)})
            for one in read(replies)
            if any(link.inside for link in one.interfaces.values())
        )

    def check(self, name: str, want: WireguardRoutesParams, found: State | None) -> Change | None:
        """Compare; what is routed and not wanted goes."""
        through = dict(found["through"]) if found else {}
        due = [one for one in want.to if through.get(one) != want.interface]
        gone = sorted(through.keys() - set(want.to))
        calls = [["route", "replace", f"{one}/32", "dev", want.interface, "src", want.address] for one in due]
        calls += [["route", "del", one] for one in gone]
        greeted = [_greeting(name, want)] if due else []
        commands = (Run(script="\n".join([*greeted, *batch(["ip", "-n", name], calls)]) or ":"),)
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=commands)
        if due or gone:
            others = sorted({through[one] for one in due if one in through})
            old = f", which go through {', '.join(others)}" if others else ""
            cause = f"{len(due)} to set{old}; {len(gone)} to remove"
            return Change(action=Action.UPDATE, cause=cause, before=found, commands=commands)
        return None

    def is_plumbing(self, name: str) -> bool:
        """Be what the overlay is made of."""
        return True

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Do nothing: they go with their interface."""
        return ()

    def is_own(self, name: str, want: WireguardRoutesParams, names: Names) -> bool:
        """Compare names."""
        link = LINK.fullmatch(want.interface)
        own = (name, want.instance) == (names.tunnel, names.instance)
        return own and link is not None and link[1] == names.tunnel


def _greeting(name: str, want: WireguardRoutesParams) -> str:
    """Return a script that shakes hands with all peers through the interface, and is over after three seconds.

    A keepalive makes WireGuard begin. After a second a robot begins with those, too, that should have.
    """
    first = [one for one in want.to if IPv4Address(one) > IPv4Address(want.address)]
    script = f"""\
greet() {{ wg show {want.interface} allowed-ips | while read -r k a; do case " $* " in *" ${{a%/*}} "*)
  wg set {want.interface} peer "$k" persistent-keepalive 25; wg set {want.interface} peer "$k" persistent-keepalive 0;;
esac; done; }}
silent() {{ wg show {want.interface} latest-handshakes | grep -q '[[:space:]]0$'; }}
greet {" ".join(first)}; n=0
while silent && [ $n -lt 30 ]; do
  sleep 0.1; n=$((n + 1)); [ $n -ne 10 ] || greet {" ".join(want.to)}
done"""
    return sh("ip", "netns", "exec", name, "sh", "-c", script)
