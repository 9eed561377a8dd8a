"""Links in a copy from a container: which file of the same copy each leads to, so that it comes as a file of its own.

Takes places as names from the user's folder on, joined by `/`; gives where each link leads. Pure. No link is made here:
it would make a name that the container chose another one of whatever lies in a second place, now or later, such as a
file of the user's or of another robot's, and whoever is sent what lies under this name would have it.
"""

from __future__ import annotations

from collections.abc import Iterator

_MOST_LINKS = 40
"""One after the other, as for the kernel."""


class Links:
    """The links of one copy."""

    def __init__(self) -> None:
        self._leads: dict[str, tuple[str, str]] = {}
        """Place of a link -> what it says, and the place that this is."""

    def __contains__(self, place: str) -> bool:
        return place in self._leads

    def add(self, place: str, link: str) -> None:
        """Note a link that stays inside of what is copied; see `stays_inside`."""
        parts = place.split("/")[:-1]
        for part in link.split("/"):
            if part == "..":
                parts.pop()
            elif part not in ("", "."):
                parts.append(part)
        self._leads[place] = link, "/".join(parts)

    def all(self) -> Iterator[tuple[str, str, str | None]]:
        """Yield each link's place, what it says, and the place that it leads to by way of others, or None.

        A link has to name that place, or a further link, as it is: behind the name of a link something of the user's
        could lie.
        """
        for place, (link, _) in sorted(self._leads.items()):
            yield place, link, self._end(place)

    def _end(self, place: str) -> str | None:
        """Return where a link leads by way of others; None where they are too many."""
        for _ in range(_MOST_LINKS):
            if place not in self._leads:
                break
            place = self._leads[place][1]
        return place if place not in self._leads else None


def stays_inside(depth: int, link: str) -> bool:
    """Return whether a link cannot lead out of what is copied, whatever other such links are in it.

    Args:
        depth: How many folders of the copy lie above the link.
        link: Where it points to. `..` may only stand at its beginning: behind the name of another link it would lead to
            wherever that one's target lies.
    """
    if link.startswith("/") or not link:
        return False
    parts = [part for part in link.split("/") if part not in ("", ".")]
    up = next((at for at, part in enumerate(parts) if part != ".."), len(parts))
    return up <= depth and ".." not in parts[up:]
