"""What a robot cannot do without: the addresses that it must go on reaching, whatever networks are made on it.

Takes the files that were read, the SSH client's address and the gateways; gives IPv4 addresses. Pure. A name of a
server is not looked up: whoever answers for it may be another tomorrow.
Source: resolv.conf(5), chrony.conf(5), ntp.conf(5), timesyncd.conf(5).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from ipaddress import IPv4Address, IPv6Address, ip_address

from srprov.facts.answers import Files

NAME_FILES = ("/etc/resolv.conf", "/run/systemd/resolve/resolv.conf", "/run/NetworkManager/resolv.conf")
TIME_FILES = (
    "/etc/chrony.conf",
    "/etc/chrony/chrony.conf",
    "/etc/chrony/sources.d/*.sources",
    "/run/chrony-dhcp/*.sources",
    "/etc/ntp.conf",
    "/etc/ntpsec/ntp.conf",
    "/etc/systemd/timesyncd.conf",
    "/etc/systemd/timesyncd.conf.d/*.conf",
)
_SERVER = re.compile(r"\s*(?:nameserver|server|pool|peer)\s+(\S{1,60})|\s*(?:Fallback)?NTP\s*=\s*(.{1,400})")
_MOST = 32


def lifelines(files: Files, client: str, gateways: Iterable[str]) -> tuple[str, ...]:
    """Return the addresses of the SSH client, gateways, name servers and time servers, sorted; loopback is left out."""
    found = {address for text in (client, *gateways, *_servers(files)) if (address := _ipv4(text))}
    return tuple(str(address) for address in sorted(found)[:_MOST])


def _servers(files: Files) -> Iterator[str]:
    for path, lines in files.items():
        if path.endswith(("resolv.conf", "chrony.conf", "ntp.conf", ".sources")) or "timesyncd.conf" in path:
            for line in lines:
                if match := _SERVER.match(line):
                    yield from (match[1] or match[2]).split()


def _ipv4(text: str) -> IPv4Address | None:
    try:
        address = ip_address(text)
    except ValueError:
        return None
    if isinstance(address, IPv6Address):
        address = address.ipv4_mapped or IPv4Address(0)  # sshd on a dual-stack socket
    usable = not (address.is_loopback or address.is_unspecified or address.is_multicast)
    return address if usable else None
