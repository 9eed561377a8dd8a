"""The hosts file: every service's name with its address, one text for all robots.

Takes an Overlay, gives the text that is mounted over /etc/hosts in the instance's containers. Pure. Docker's own DNS
knows only the containers of its robot, so names across robots come from this file. A container with its robot's network
has that robot's own lines as well, as Docker alone would give it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from ipaddress import ip_address
from types import MappingProxyType

from srprov import names
from srprov.network.model import Overlay

_NONE: Mapping[str, str] = MappingProxyType({})
_LOCAL = """\
127.0.0.1\tlocalhost
::1\tlocalhost ip6-localhost ip6-loopback
ff02::1\tip6-allnodes
ff02::2\tip6-allrouters
"""


class HostsFile:
    """The hosts file: localhost, one line per service, then one per instance of what runs several times.

    A resolver gives all addresses of a name that has several lines. What all robots have is made once.
    """

    def __init__(self, overlay: Overlay, hostnames: Mapping[str, str] = _NONE) -> None:
        """Take who has which address; `hostnames` is service -> a second name of it."""
        given = [*sorted(overlay.names.items())]
        given += [(name, address) for name, addresses in sorted(overlay.aliases.items()) for address in addresses]
        given += sorted(
            (name, overlay.names[service]) for service, name in hostnames.items() if service in overlay.names
        )
        self.text = _LOCAL + _lines(given)
        """As robots have it whose containers need no more."""
        self._taken = {*names.RESERVED, *(name.lower() for name, _ in given)}

    def with_more(self, extra: Sequence[tuple[str, str]] = (), own: Iterable[str] = ()) -> str:
        """Return it with more lines.

        Args:
            extra: (name, address) of further lines.
            own: Lines of the robot's own file, which come last; of a name that stands above, none of them counts.
        """
        taken = {name.lower() for name, _ in extra} | self._taken if extra else self._taken
        more = "".join([_lines(extra), *_without(taken, own)])
        return self.text + more if more else self.text


def _lines(given: Iterable[tuple[str, str]]) -> str:
    return "".join(f"{ip_address(address)}\t{name}\n" for name, address in given)


def _without(taken: Collection[str], own: Iterable[str]) -> Iterator[str]:
    """Yield a robot's lines without names that mean something else: a resolver gives all addresses of a name."""
    for address, *named in map(str.split, own):
        if kept := [name for name in named if name.lower() not in taken]:
            yield f"{address}\t{' '.join(kept)}\n"
