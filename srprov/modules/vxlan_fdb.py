"""Forwarding entries of a VXLAN link, and of the bridge behind it. Pure.

An entry is a pair of MAC and VTEP; one of the bridge, which only says that the MAC is behind the link, has no VTEP.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from srprov.resource import State

FLOOD = "00:00:00:00:00:00"
"""Broadcast and multicast, and what no other entry is for."""


def entries_of(fdb: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the entries of the link, and with no VTEP those of the bridge: one for each service that is elsewhere."""
    pairs = {(mac, vtep) for mac, vtep in fdb}
    return pairs | {(mac, "") for mac, _ in pairs if mac != FLOOD}


def known(bridge: str, found: State) -> set[tuple[str, str]]:
    """Return the entries that are there; those of another bridge go with it."""
    pairs = {(mac, vtep) for mac, vtep in found["fdb"]}
    return pairs | {(mac, "") for mac in found["bridge_fdb"] if found["bridge"] == bridge}


def fdb_calls(name: str, there: Collection[tuple[str, str]], fdb: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Return calls of bridge(8). All-zero entries are appended (several may stand side by side), others replaced."""
    wanted, calls = entries_of(fdb), []
    for mac, vtep in sorted(set(there) - wanted):
        calls.append(["fdb", "del", mac, "dev", name, *(["dst", vtep, "self"] if vtep else ["master"])])
    for mac, vtep in sorted(wanted - set(there)):
        verb = "append" if mac == FLOOD else "replace"
        place = ["dst", vtep, "self", "permanent"] if vtep else ["master", "static"]
        calls.append(["fdb", verb, mac, "dev", name, *place])
    return calls
