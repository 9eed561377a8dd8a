"""What a copy between this machine and a container has done so far, while more of it comes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from srprov.definitions.model import repository_in
from srprov.errors import visible

_MOST_TOLD, _LONGEST = 1000, 400
"""Things that are left out and named, and characters of each of their names."""


@dataclass
class Copied:
    """What was copied so far; it is told while more comes."""

    files: int = 0
    bytes: int = 0
    left_out: list[str] = field(default_factory=list)
    """What was not, and why: the first ones."""
    more_left_out: int = 0
    lost: bool = False
    """Whether something was left out that did not come under another name."""
    _repository: str = ""
    """The last one that was left out."""

    def leave_out(self, path: str, why: str, *, lost: bool = True) -> None:
        """Note that something does not come; a container may have any number of such things."""
        self.lost = self.lost or lost
        if len(self.left_out) < _MOST_TOLD:
            self.left_out.append(f"{visible(path[:_LONGEST])}: {visible(why[:_LONGEST])}")
        else:
            self.more_left_out += 1

    def leave_repository(self, parts: Sequence[str], first: int, *, folder: bool) -> bool:
        """Return whether something would make a repository here, or lies in what would, and note that once.

        Args:
            parts: The names on the way to it.
            first: The first one that the container chose.
            folder: Whether it is a folder itself.
        """
        at = repository_in(parts, folder=folder, first=first)
        if at is None:
            return False
        if (path := "/".join(parts[: at + 1])) != self._repository:
            self._repository = path
            self.leave_out(path, "a repository here could name programs; take it as a tar, with `-`")
        return True
