"""Whether programs of a robot ask on every link, so that containers answer: avahi-daemon, systemd-resolved, dhcpcd.

Gives a question and judges the answer. Pure; that is untrusted. An engine's bridges and veths are links of the robot
itself, and whoever is behind one may answer. Programs in networks or containers of their own do not count. What is
given on a command line, or in a file of another name (`-f`), is not looked at; nor is mDNS of systemd-resolved, as
which of its links have that is told over D-Bus alone.

Source: avahi-daemon.conf(5); dhcpcd.conf(5), whose options below `interface`, `ssid` or `profile` are not for all
links; resolved.conf(5), of which LLMNR holds for each link that nobody took it from; proc(5); tried on lab robots.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase

from srprov.facts.model import HostFacts
from srprov.untrusted import lines_of, text
from srprov.wire import Query, Reply

# Names of programs have 15 characters there. dhcpcd has a file without a link's name where it is for all links. 14EB is
# LLMNR's port, which systemd-resolved, as a user of its own, has open while that is on. dhcpcd's file may hold keys,
# so that only what is asked for leaves the robot.
EVERY_LINK = Query(
    command="""\
grep -lsxE 'avahi-daemon|dhcpcd|systemd-resolve' /proc/[0-9]*/comm | while IFS= read -r f; do
  d=${f%/comm} c= u=
  for k in net pid; do [ ! -e "$d/ns/$k" ] || [ "$d/ns/$k" -ef /proc/self/ns/$k ] || continue 2; done
  IFS= read -r c 2>/dev/null <"$f"
  case $c in
    dhcpcd) [ -e /run/dhcpcd/pid ] || [ -e /run/dhcpcd.pid ] || continue;;
    systemd-resolve)
      while read -r k v r; do [ "$k" = Uid: ] && u=$v && break; done 2>/dev/null <"$d/status"
      grep -sh '^[^:]*: [0-9A-F]*:14EB ' /proc/net/udp /proc/net/udp6 | while read -r n l r s q t w i o; do
        [ "$i" = "$u" ] && echo llmnr && break
      done;;
  esac
  echo "$c"
done | sort -u
grep -sihm 16 '^[[:blank:]]*allow-interfaces=' /etc/avahi/avahi-daemon.conf | cut -c1-1000
sed -n -e '/^[[:blank:]]*interface\\([[:blank:]].*\\)*$/q' -e '/^[[:blank:]]*ssid\\([[:blank:]].*\\)*$/q' \\
  -e '/^[[:blank:]]*profile\\([[:blank:]].*\\)*$/q' \\
  -e '/^[[:blank:]]*allowinterfaces[[:blank:]]/p' -e '/^[[:blank:]]*denyinterfaces[[:blank:]]/p' \\
  /etc/dhcpcd.conf 2>/dev/null | head -n 16 | cut -c1-1000
:"""
)
_MOST_LINES = 40
_LINE = 1000
_MOST_NAMES = 100
_CONTAINERS = re.compile(r"docker.*|br-[0-9a-f]{12}|veth.*|srp[bv].*")
_ONE_OF_EACH = ("docker0", "br-0123456789ab", "veth0123abc", "srpb01234567", "srpv01234567")
_DENY = "denyinterfaces veth* docker0 srpb* srpv* br-*"
_LINK = re.compile(r"[A-Za-z0-9_.-]{1,15}")
_MOST_LINKS = 8

Judged = tuple[str, bool, str, str]
"""The program, whether it is right, what is there, and what to do."""


def every_link(reply: Reply, facts: HostFacts) -> Iterator[Judged]:
    """Return what is to be said of each program, in a fixed order."""
    said = [text(line, length=_LINE) for line in lines_of(reply.out, _MOST_LINES)]
    own = _own(facts)
    yield _judged(
        "avahi", "avahi-daemon" in said, _avahi_is_kept(said), "can answer for every name in .local",
        f"write allow-interfaces={','.join(own) or 'LINK'} below [server] in /etc/avahi/avahi-daemon.conf and restart "
        "avahi-daemon; deny-interfaces is not enough, as each container brings a link with a name of its own",
    )  # fmt: skip
    yield _judged(
        "resolved", "systemd-resolve" in said, "llmnr" not in said, "can answer for every name without a dot (LLMNR)",
        "write LLMNR=no below [Resolve] in /etc/systemd/resolved.conf, and MulticastDNS=no unless something needs it, "
        "and restart systemd-resolved",
    )  # fmt: skip
    # an uplink such as br-lan has to stay
    deny = _DENY.replace("br-*", f"br-{12 * '?'}") if any(link.startswith("br-") for link in own) else _DENY
    yield _judged(
        "dhcpcd", "dhcpcd" in said, _dhcpcd_is_kept(said), "can give it a lease, and with it a name server",
        f"write `{deny}` into /etc/dhcpcd.conf, above the first line with `interface`, and restart dhcpcd",
    )  # fmt: skip


def _judged(name: str, runs: bool, kept: bool, what: str, remedy: str) -> Judged:
    if not runs:
        return name, True, "it does not run for all links", ""
    found = "it does not ask on links of containers" if kept else f"it asks on links of containers, which {what}"
    return name, kept, found, remedy


def _avahi_is_kept(said: Sequence[str]) -> bool:
    """Only a list of what is allowed is enough, with a name in its last line, and none of a container's link."""
    lists = [line.partition("=")[2] for line in said if line.lower().startswith("allow-interfaces=")]
    names = [name.strip() for line in lists for name in line.split(",")]
    return bool(lists and lists[-1].strip(", ")) and not any(_CONTAINERS.fullmatch(name) for name in names)


def _dhcpcd_is_kept(said: Sequence[str]) -> bool:
    """None of the links that containers have is asked: not allowed where some are, or denied."""
    allowed, denied = _patterns(said, "allowinterfaces"), _patterns(said, "denyinterfaces")
    asked = [name for name in _ONE_OF_EACH if not allowed or _matches(name, allowed)]
    return all(_matches(name, denied) for name in asked)


def _patterns(said: Sequence[str], option: str) -> list[str]:
    values = [line[len(option) :].partition("#")[0] for line in said if line.startswith(option)]
    return " ".join(values).replace(",", " ").split()[:_MOST_NAMES]


def _matches(name: str, patterns: Sequence[str]) -> bool:
    with suppress(re.error):  # of a range such as [z-a]
        return any(fnmatchcase(name, one) for one in patterns)
    return False


def _own(facts: HostFacts) -> list[str]:
    """Return names of the links by which it is reached: its underlay, and its network cards that have an address."""
    cards = (link.name for link in facts.links if not link.kind and link.name != "lo" and link.addresses)
    names = dict.fromkeys((facts.underlay_link, *cards))
    return [name for name in names if _LINK.fullmatch(name) and not _CONTAINERS.fullmatch(name)][:_MOST_LINKS]
