"""Whether the links of a tree stay in it, as the kernel goes by them, whatever others of them are on the way. Pure."""

from __future__ import annotations

from collections.abc import Mapping

MOST_STEPS = 1_000_000
"""That all links of a tree may lead over together."""
_MOST_LINKS = 40
"""That one path may lead over."""


def leaving(links: Mapping[str, str]) -> str:
    """Return the first link that leads out of a tree, or nothing.

    Args:
        links: Path -> where it leads, of every link of the tree; paths have no link on their way.

    Raises:
        ValueError: They lead over too many folders.
    """
    root, steps = _Place(), MOST_STEPS
    for path, target in links.items():
        root.below(path).target = target
    for path in sorted(links):
        taken = _stays(path, root, steps)
        if taken is None:
            return path
        steps -= taken
        if steps <= 0:
            raise ValueError(f"its links lead over more than {MOST_STEPS} folders")
    return ""


class _Place:
    """A name in a tree that a link has, or that is above one."""

    __slots__ = ("places", "target")

    def __init__(self) -> None:
        self.places: dict[str, _Place] = {}
        self.target = ""

    def below(self, path: str) -> _Place:
        """Return the place of a path, which is made."""
        here = self
        for part in path.split("/"):
            here = here.places.setdefault(part, _Place())
        return here


def _stays(path: str, root: _Place, most: int) -> int | None:
    """Walk a path as the kernel does, at most so many steps; return how many, or None where it leaves the tree."""
    ahead, behind = path.split("/")[::-1], [root]  # type: list[str], list[_Place]
    followed = steps = 0
    while ahead and steps < most:
        part = ahead.pop()
        steps += 1
        if part in ("", "."):
            continue
        if part == "..":
            if len(behind) == 1:
                return None
            behind.pop()
            continue
        here = behind[-1].places.get(part, _NOWHERE)
        if here.target:
            followed += 1
            if here.target.startswith("/") or "\0" in here.target or followed > _MOST_LINKS:
                return None
            ahead += here.target.split("/")[::-1]
        else:
            behind.append(here)
    return steps


_NOWHERE = _Place()
