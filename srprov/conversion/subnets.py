"""The subnets of a Compose file's networks, and whether an address is in one of them. Pure."""

from __future__ import annotations

import bisect
import contextlib
import ipaddress
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec


class Subnets(msgspec.Struct, frozen=True):
    """Those of each version of IP, sorted: an address is looked for in thousands of them at once."""

    first: Mapping[int, list[int]]
    last: Mapping[int, list[int]]

    @classmethod
    def of(cls, networks: Mapping[str, Any]) -> Subnets:
        """Take the networks of a project; what is no subnet is left out."""
        written = list(_written(networks))
        four = list(ipaddress.collapse_addresses(ipaddress.IPv4Network(one) for one in written if ":" not in one))
        six = list(ipaddress.collapse_addresses(ipaddress.IPv6Network(one) for one in written if ":" in one))
        return cls(
            {4: [int(one.network_address) for one in four], 6: [int(one.network_address) for one in six]},
            {4: [int(one.broadcast_address) for one in four], 6: [int(one.broadcast_address) for one in six]},
        )

    def have(self, address: str) -> bool:
        """Return whether a text is an address in one of them."""
        try:
            given = ipaddress.ip_address(address)
        except ValueError:  # host-gateway; what is no address is told when the experiment is checked
            return False
        at = bisect.bisect_right(self.first[given.version], int(given)) - 1
        return at >= 0 and int(given) <= self.last[given.version][at]


def _written(networks: Mapping[str, Any]) -> Iterator[str]:
    for network in networks.values():
        for one in ((network or {}).get("ipam") or {}).get("config") or ():
            with contextlib.suppress(ValueError):
                yield str(ipaddress.ip_network(str(one.get("subnet") or "")))
