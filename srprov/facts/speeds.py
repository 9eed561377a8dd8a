"""How fast a robot's links are, and how busy the underlay is. Pure; what a robot says is untrusted.

Source: sysfs-class-net, proc(5).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from srprov.facts.answers import Counters, Files, parse_traffic
from srprov.facts.model import Link
from srprov.session import Measures
from srprov.untrusted import integer
from srprov.wire import Reply


def with_speeds(
    links: Sequence[Link], files: Files, wireless: Mapping[str, float], measures: Measures | None
) -> tuple[Link, ...]:
    """Return the links with their speeds: psutil's, else that of the radio, else what the kernel says."""
    measured = measures.link_speed_mbit if measures else {}
    speeds = {**_speeds(files), **{k: v for k, v in (*wireless.items(), *measured.items()) if v > 0}}
    return tuple(replace(link, speed_mbit=speeds.get(link.name, 0.0)) for link in links)


def _speeds(files: Files) -> dict[str, float]:
    """Return Mbit/s by interface; -1 means unknown, and so does 4294967295, the same in old drivers."""
    found = {}
    for path, lines in files.items():
        if name := re.fullmatch(r"/sys/class/net/([^/]{1,15})/speed", path):
            speed = integer(lines[0], low=-1, high=2**40, default=-1)
            found[name[1]] = float(speed) if 0 < speed < 10_000_000 else 0.0
    return found


def _traffic(files: Files, later: Reply | None) -> Mapping[str, Counters]:
    """Return bytes per second between the two readings."""
    first = [line for path in ("/proc/uptime", "/proc/net/dev") for line in files.get(path, ())]
    return parse_traffic("\n".join([*first, later.out])) if later is not None else {}


def traffic_mbit(files: Files, later: Reply | None, link: str, shared_air: bool) -> float:
    """Return Mbit/s on a link: the busier direction of a cable, or both of a radio, which share the air."""
    seen = _traffic(files, later).get(link)
    if seen is None:
        return 0.0
    both = (seen.received_bps, seen.sent_bps)
    return round(min((sum(both) if shared_air else max(both)) * 8 / 1e6, 1e6), 3)
