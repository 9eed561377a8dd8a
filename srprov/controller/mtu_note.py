"""Why all containers of an overlay are made anew: a robot whose link carries less changes its MTU. Pure."""

from __future__ import annotations

from srprov.facts.model import Snapshot
from srprov.network.model import Overlay


def mtu_notes(overlay: Overlay, snapshot: Snapshot) -> tuple[str, ...]:
    """Return a note when networks of the overlay that are there have a larger MTU than it gets.

    Docker gives a network its MTU when it makes it, and containers theirs when they join.
    """
    had = {
        int(one.state["mtu"])
        for things in snapshot.observed.values()
        for one in things
        if (one.module, one.name, one.instance) == ("network", overlay.network, overlay.instance)
    }
    most = max(had, default=0)
    if not overlay.active or most <= overlay.mtu:
        return ()
    members = [(snapshot.facts[robot].underlay_mtu, robot) for robot in overlay.vteps if robot in snapshot.facts]
    carries, robot = min(members, default=(0, ""))
    why = f", as {robot}'s link carries {carries} bytes" if robot and carries < most + 50 else ""
    return (
        f"the overlay's MTU is {most} and becomes {overlay.mtu}{why}: its networks, and the containers on them, "
        "are made anew on all robots; where robots with narrow links may join later, begin with a smaller network.mtu",
    )
