"""Where paths of a container lead by its links, followed one by one as it would, and what is there.

An image chooses how many folders and links lie above what is mounted in its containers, and a robot may say anything of
them. So all paths are followed together, what was looked at is known from then on, and everything has an end.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Collection, Mapping, Sequence

from msgspec.structs import replace

from srprov.errors import RefusedError
from srprov.transport.container_look import Found
from srprov.transport.container_view import Part, View
from srprov.untrusted import is_too_long

UPDATE = "update the robot's Docker Engine to 29.5.1 or later"
"""What always helps."""
_MOST_LINKS = 40
"""Of one path, as for Linux."""
_MOST_ROUNDS = 32
"""In which a robot is asked; each takes a round trip, and follows one more link of all paths."""
_MOST_LOOKS = 100
"""At folders of the robot: each takes a sandbox of its own."""
_LONGEST_NAMES = 1 << 20
"""Bytes of all that is asked for."""
_PER_NAME = 32
_MOST_STEPS = 30_000
"""Of all paths: a thousand behind two links each, gone through ten times."""
_OF_ONE_STEP = 80
"""Characters of a path; longer ones lie in more folders, and count more."""

Look = Callable[[str, Mapping[str, Collection[str]]], Mapping[str, Mapping[str, Found]]]
"""Asks a robot, for a path, what is at names: folder of the robot -> names below it, and -> what is at those there."""
Place = tuple[str, str]
"""Folder of the robot, and a name below it, as `find` says it."""


class Walk:
    """What is known of the files of one container."""

    def __init__(
        self, look: Look, part_of: Callable[[View, str], Part], refused: Callable[[str, str, str], RefusedError]
    ) -> None:
        """Take what asks the robot, what says in which part a path lies, or refuses, and how a refusal is said."""
        self._ask, self._part_of, self._refused = look, part_of, refused
        self._found: dict[Place, Found | None] = {}
        self._links: dict[Place, tuple[str, str] | None] = {}
        """The first link on the way to a place, or at it: its name, and where it leads."""
        self._missing: dict[str, dict[str, None]] = {}
        self._rounds = self._looks = self._length = self._steps = 0

    def to(self, view: View, path: str, *, follow: bool) -> tuple[str, Found | None]:
        """Return where a path leads in a view, by no link, and what is there; the last link only if asked.

        Raises:
            RefusedError: Nothing can be read there, or its links have no end.
        """
        while (led := self._led(view, path, follow=follow)) is None:
            self._look(path)
        return led

    def settled(self, seen: View) -> View:
        """Return a view with each mount also where links in the container's files have led it.

        Raises:
            RefusedError: As above.
        """
        root = next((one for one in seen.parts if one.at == "/"), None)
        waiting = sorted((one for one in seen.parts if one.at != "/"), key=lambda one: len(one.at))
        if root is None or not waiting:
            return seen
        for one in waiting:
            self._miss(one.at, _place(root, one.at))
        self._look("/")
        if not any(self._links.values()):
            return seen
        view, waiting = self._settle(seen.of([root]), waiting)
        while waiting:
            self._look(waiting[0].at)
            view, waiting = self._settle(view, waiting)
        return seen.of(dict.fromkeys([*seen.parts, *view.parts]))

    def _settle(self, view: View, waiting: Sequence[Part]) -> tuple[View, list[Part]]:
        """Go on with all mounts, each among those before it; return where they are, and those that still wait."""
        left: list[Part] = []
        for one in waiting:
            try:
                led = self._led(view, one.at, follow=True)
            except RefusedError:
                if not left:  # else it may lead into one that still waits
                    raise
                led = None
            if led is None or left:
                left.append(one)
            else:
                view = view.of([*view.parts, replace(one, at=led[0])])
        return view, left

    def _led(self, view: View, path: str, *, follow: bool) -> tuple[str, Found | None] | None:
        """Go as far as all is known; None: something has to be looked at first."""
        above, names = "/", names_of(path)
        for _ in range(_MOST_LINKS):
            self._count(path, posixpath.join(above, *names))
            up = names.index("..") if ".." in names else len(names)
            whole = posixpath.join(above, *names[:up])
            part = self._part_of(view, whole)
            place = _place(part, whole)
            if place not in self._found:
                self._miss(path, place)
                return None
            first = self._links[place]
            link = "" if first is None else part.at if part.name else posixpath.join(part.at, first[0][2:])
            if first is not None and (link != whole or follow or names[up:]):
                after = names_of(whole[len(link) :]) + names[up:]
                above, names = "/" if first[1].startswith("/") else posixpath.dirname(link), names_of(first[1]) + after
            elif names[up:]:
                above, names = posixpath.dirname(whole), names[up + 1 :]
            else:
                return whole, None if part.name and whole != part.at else self._found[place]
        raise self._refused(path, "links lead in a circle", "")

    def _count(self, path: str, whole: str) -> None:
        self._steps += 1 + len(whole) // _OF_ONE_STEP
        if is_too_long(whole):
            raise self._refused(path, "it is, or its links make it, longer than a path of Linux", "")
        if self._steps > _MOST_STEPS:
            raise self._refused(path, "it, or what is mounted, lies behind more links than are followed", UPDATE)

    def _miss(self, path: str, place: Place) -> None:
        """Note that a place is to be looked at, and all above it there."""
        root, name = place
        missing = self._missing.setdefault(root, {})
        while name not in missing and (root, name) not in self._found:
            missing[name] = None
            self._length += len(name) + _PER_NAME
            if self._length > _LONGEST_NAMES:
                raise self._refused(path, "it, or what is mounted, lies in more folders than are looked at", UPDATE)
            name = posixpath.dirname(name)
            name = "./." if name == "." else name

    def _look(self, path: str) -> None:
        """Look at all that is missing, in one round trip."""
        self._rounds, self._looks = self._rounds + 1, self._looks + len(self._missing)
        if self._rounds > _MOST_ROUNDS or self._looks > _MOST_LOOKS:
            raise self._refused(path, "it, or what is mounted, lies behind more links than are followed", UPDATE)
        asked, self._missing = self._missing, {}
        for root, found in self._ask(path, asked).items():
            for name in sorted(asked[root], key=len):  # what holds another one comes before it
                one = self._found[root, name] = found.get(name)
                own = (name, one.link) if one is not None and one.kind == "l" else None
                self._links[root, name] = self._links.get((root, posixpath.dirname(name))) or own


def names_of(path: str) -> list[str]:
    """Return the names of a path, one by one."""
    return [name for name in path.split("/") if name not in ("", ".")]


def _place(part: Part, path: str) -> Place:
    return part.root, f"./{part.below(path)}"
