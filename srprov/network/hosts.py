"""The hosts file: every service's name with its address, one text for all robots.

Takes an Overlay, gives the text that is mounted over /etc/hosts in the instance's containers. Pure. Docker's own DNS
knows only the containers of its robot, so names across robots come from this file.
"""

from __future__ import annotations

from ipaddress import ip_address

from srprov.network.model import Overlay

_LOCAL = """\
127.0.0.1\tlocalhost
::1\tlocalhost ip6-localhost ip6-loopback
ff02::1\tip6-allnodes
ff02::2\tip6-allrouters
"""


def hosts_file(overlay: Overlay) -> str:
    """Return the hosts file: localhost, one line per service, then one per instance of what runs several times.

    A resolver gives all addresses of a name that has several lines.
    """
    lines = [f"{ip_address(address)}\t{name}\n" for name, address in sorted(overlay.names.items())]
    lines += [
        f"{ip_address(address)}\t{name}\n"
        for name, addresses in sorted(overlay.aliases.items())
        for address in addresses
    ]
    return _LOCAL + "".join(lines)
