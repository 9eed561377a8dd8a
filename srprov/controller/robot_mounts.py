"""What is mounted on a robot, by its own word: the further names of its folders, and what can be written.

Takes what a robot says; gives places as texts. Pure.
"""

from __future__ import annotations

import functools
import re
from bisect import bisect_left
from collections.abc import Iterable

from srprov.robot_answers import TooManyError
from srprov.untrusted import lines_of
from srprov.wire import Query

MOUNTS = Query(command="cat /proc/self/mountinfo")
_MOST_LINES = 100_000
_MOST_LOOKS = 2_000_000
"""At names, for all questions about one robot; a robot has hundreds of mounts, and looks at each about once."""
_OF_ONE_LOOK = 64
"""Characters of a name; longer ones count more."""
_MOST_LAYERS = 501
"""Of an overlay; source: OVL_MAX_STACK, and the upper one."""
_LONGEST = 4096
_LONGEST_TOLD = 4 * _LONGEST
"""Each character may be told by the number of its byte."""
_MOUNT = re.compile(r"([0-9]+) ([0-9]+) ([0-9]+:[0-9]+) (/\S*) (/\S*) (.*)", re.ASCII)
"""Its number, that of the mount it is on, file system, the place in it, where, and more; source: proc(5)."""
_LAYERS = re.compile(r"(?:lowerdir\+?|upperdir)=([^,\s]+)")
"""Folders that an overlay shows as one; source: the kernel's overlayfs.rst."""
_OCTAL = re.compile(r"\\([0-7]{3})")


class Mounts:
    """What is mounted on a robot, by its own word: one folder may be shown at several places, or a part of it.

    What it says may have no end: each look at a name is counted, and beyond two million TooManyError is raised.
    """

    def __init__(self, said: str) -> None:
        """Take what the robot says; lines that are none of a mount are passed over."""
        lines = lines_of(said, _MOST_LINES + 1)
        found = [match.groups() for line in lines[:_MOST_LINES] if (match := _MOUNT.fullmatch(line))]
        too_long = any(len(root) > _LONGEST_TOLD or len(point) > _LONGEST_TOLD for *_, root, point, _ in found)
        found = [] if too_long else found
        points = [point.rstrip("/") for *_, point, _ in map(_plain, found)]
        numbers = {number for number, *_ in found}
        self._on: dict[tuple[str, str], tuple[str, str, str]] = {}
        """Number of a mount, and where another one is mounted on it -> that: its number, file system and place."""
        for point, (number, above, fs, root, *_) in zip(points, map(_plain, found), strict=True):
            on = above if above in numbers and above != number else ""
            self._on[on, f"{point}/"] = number, fs, root.rstrip("/")
        self._points = sorted({*points})
        self._writable = sorted(
            {
                _plain((point,))[0]
                for *_, point, more in found
                if more.startswith("rw") and more.rpartition(" ")[2].startswith("rw")
            }
        )
        self._layers: dict[str, dict[str, None]] = {}
        """File system of an overlay -> the folders that it shows."""
        for _, _, fs, *_, more in found:
            for some in _LAYERS.findall(more) if " - overlay " in more else ():
                layers = _plain(one for one in some.split(":") if one.startswith("/"))[:_MOST_LAYERS]
                self._layers.setdefault(fs, {}).update(dict.fromkeys(one for one in layers if len(one) <= _LONGEST))
        beyond = too_long or len(lines) > _MOST_LINES  # what is mounted there may be any folder
        self._looks = _MOST_LOOKS if beyond else 0

    def places(self, real: str) -> set[str]:
        """Return a path's file system and its place in that, with a slash at its end; of an overlay its layers'."""
        fs, within = self._place(real)
        layers = [self._place(f"{one.rstrip('/')}/{within}".rstrip("/")) for one in self._layers.get(fs, ())]
        return {f"{one} /{below}" for one, below in ((fs, within), *layers) if one}

    def _place(self, real: str) -> tuple[str, str]:
        """Go from mount to mount as the kernel does; what is hidden by a later one above it is passed by."""
        number, seen, found, whole = "", set[str](), ("", ""), f"{real}/"
        for slash in re.finditer("/", whole):
            point = whole[: slash.end()]
            self._count(1, len(point))
            while (one := self._on.get((number, point))) and one[0] not in seen:
                self._count(1)
                number, fs, root = one
                seen.add(number)
                found = fs, f"{root}/{real[len(point) :].strip('/')}/".replace("//", "/").lstrip("/")
        return found

    def shown(self, every: Iterable[str]) -> set[str]:
        """Return the places of some folders, and of all that is mounted below them."""
        folders = {one.rstrip("/") for one in every}
        below = {point for one in folders for point in self._among(self._points, one)}
        return set().union(*(self.places(one) for one in folders | below))

    def writable_below(self, real: str) -> list[str]:
        """Return where something is mounted below a folder that can be written, also where the folder itself cannot."""
        return self._among(self._writable, real.rstrip("/"))

    def names(self, real: str) -> set[str]:
        """Return where else a folder is shown, or a part of it, or of what is mounted below it; also itself.

        An overlay shows what lies in its layers; what is seen by the overlay has no further name below them.
        """
        found: set[str] = set()
        own = map(self._place, [real.rstrip("/"), *self._among(self._points, real.rstrip("/"))])
        for place in {f"{fs} /{within}" for fs, within in own if fs}:
            inside = self._places[bisect_left(self._places, place) : bisect_left(self._places, f"{place[:-1]}0")]
            found.update(point for one in inside for point in self._shown_at[one])
            for slash in re.finditer("/", place):  # the longer ones of what holds it were found above
                above = place[: slash.end()]
                self._count(1 + len(self._shown_at.get(above, ())), len(place))
                if above in self._shown_at:
                    found.update(f"{point}/{place[len(above) :]}" for point in self._shown_at[above])
            self._count(len(inside))
        return {one.rstrip("/") or "/" for one in found}

    @functools.cached_property
    def _shown_at(self) -> dict[str, list[str]]:
        """Place -> where it is mounted."""
        found: dict[str, list[str]] = {}
        for point in self._points:
            for one in self.places(point):
                found.setdefault(one, []).append(point)
        return found

    @functools.cached_property
    def _places(self) -> list[str]:
        return sorted(self._shown_at)

    def _among(self, points: list[str], folder: str) -> list[str]:
        """Return those of sorted points that lie below a folder."""
        found = points[bisect_left(points, f"{folder}/") : bisect_left(points, f"{folder}0")]  # "0" follows "/"
        self._count(1 + len(found))
        return found

    def _count(self, looks: int, length: int = 0) -> None:
        self._looks += looks * (1 + length // _OF_ONE_LOOK)
        if self._looks > _MOST_LOOKS:
            raise TooManyError("more is mounted there than can be looked through")


def _plain(words: Iterable[str]) -> tuple[str, ...]:
    return tuple(_OCTAL.sub(lambda match: chr(int(match[1], 8)), one) for one in words)
