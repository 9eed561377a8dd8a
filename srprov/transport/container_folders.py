"""Files of a container without its engine: each path is read and written in the folder of the robot that it lies in.

For engines that would mount a container's volumes where its links lead (`container_view.py`). Each folder is entered
in a sandbox, as one whose names others choose: a link that the container makes meanwhile leads to nothing else of the
robot. Links are followed here, one by one, as the container would. GNU tar and find are needed on the robot.
"""

from __future__ import annotations

import posixpath
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.container_files import ContainerFiles, InContainer, is_mended
from srprov.errors import RefusedError, TransportError, UsageError, visible
from srprov.sandbox import ELSEWHERE, LED_OUT, MISSING, NO_SANDBOX, NOT_CLOSED, ending, inside, sandboxed
from srprov.transport import container_view
from srprov.transport.container_look import LOOK, Found, decoded, looked, text_of, told
from srprov.transport.container_streams import failed, given, taken
from srprov.transport.container_tar import written_anew
from srprov.transport.container_view import About, Part, View
from srprov.transport.container_walk import UPDATE, Walk
from srprov.untrusted import mapping, string
from srprov.wire import EngineQuery, Query, quote

if TYPE_CHECKING:
    from srprov.transport.engine_streams import EngineStreams

_NO_TOOLS, _NOT_ROOT = 46, 49
_WHY = {
    MISSING: "it is gone: was its container stopped?",
    LED_OUT: "a link took the place of a folder meanwhile",
    _NO_TOOLS: "GNU tar and find are needed on the robot",
    NO_SANDBOX: NOT_CLOSED,
    ELSEWHERE: "its folder leads elsewhere than a moment ago",
    _NOT_ROOT: "only root reads there",
}
_ROOT = f'[ "$(id -u)" = 0 ] || exit {_NOT_ROOT}; '
_FIND = f"find . -prune -printf '' && command -v xargs >/dev/null || exit {_NO_TOOLS}; "
_GNU = f"tar --version 2>/dev/null | grep -q GNU || exit {_NO_TOOLS}; "
_IN = f'cd -- "$what" || exit {MISSING}; case "$(pwd -P)/" in "$here"/*) ;; *) exit {LED_OUT} ;; esac; '
_TAR = (
    "tar --create --format=posix --numeric-owner '--pax-option=delete=atime,delete=ctime' --warning=no-file-changed "
    '--warning=no-file-ignored -- "$what"'
)
_UNTAR = f"{_IN}printf 'ready\\n' && tar --extract --preserve-permissions --same-owner --numeric-owner"
_MOST_LISTED = 6 << 20
"""Bytes of the names of what is there already."""
_LISTING_S = 120.0
_SHOWN = 200


def files_of(session: EngineStreams, container: str, engine: ContainerFiles) -> ContainerFiles:
    """Return the way to a container's files: its engine, where that mounts nothing by a name that others may change.

    Raises:
        TransportError: The engine says nothing of it, or the robot is gone.
    """
    version, inspected = session.ask([EngineQuery(path="/version"), EngineQuery(path=f"/containers/{container}/json")])
    if is_mended(string(mapping(version.json()).get("Version"))):
        return engine
    if not inspected.ok:
        said = f"{container} cannot be looked at: {inspected.err or 'its engine does not know it'}"
        raise TransportError(session.host, said, hint="srprov status lists what is there", code=Code.ENGINE)
    found = container_view.about(inspected.json())
    # a container that ran when this began may have ended since
    return engine if session.holds_lock and _alone(session, found) else FolderFiles(session, container, found)


def _alone(session: EngineStreams, one: About) -> bool:
    """Return whether nobody can change what a container sees: no container runs, and it has no path of the robot's.

    One that runs may hold an open folder of a volume that it does not have, handed to it by a container that had it.
    """
    if one.running or container_view.has_paths(one):
        return False
    (reply,) = session.ask([EngineQuery(path="/containers/json")])  # those that run, as nothing else is asked for
    return reply.ok and reply.json() == []


class FolderFiles:
    """A `ContainerFiles` of one container, as it is looked at now."""

    def __init__(self, session: EngineStreams, container: str, found: About) -> None:
        """Take the robot, and what its engine says of the container."""
        self._session, self._container, self._about = session, container, found
        if found.remapped:
            raise self._refused("/", "its users have other numbers on the robot", UPDATE)
        if found.too_many:
            raise self._refused("/", "it has more mounts than are looked at, or longer ones", UPDATE)
        (said,) = self._asked("/", container_view.sources_script(found))
        self._walked = Walk(self._look, self._part_of, self._refused)
        self._view = self._walked.settled(container_view.view(found, said))

    def path_in(self, _container: str, path: str) -> InContainer | None:
        """Say what is at a path; see `ContainerFiles.path_in`."""
        _, found = self._walk(path, follow=False)
        if found is None:
            return None
        link = self._walk(path, follow=True)[0] if found.kind == "l" else ""
        size = found.size if found.kind == "f" else 0
        return InContainer(is_folder=found.kind == "d", is_file=found.kind == "f", size=size, link=link)

    def copy_out(self, _container: str, path: str) -> Iterator[bytes]:
        """Yield a path as a tar; see `ContainerFiles.copy_out`."""
        path, found = self._walk(path, follow=False)
        part = self._part(path)
        if found is not None and found.kind == "d" and (other := self._view.mounted_below(path)):
            why = f"{other} is mounted in it, and would be missing"
            raise self._refused(path, why, f"copy what lies there, and beside it, by its own path; or {UPDATE}")
        script = inside(part.root, part.below(path), _GNU + _TAR, part.root)
        streams = self._session.open_shell(ending(_ROOT + script))
        return taken(self._session.host, streams, path, _WHY)

    def copy_into(self, _container: str, folder: str, tar: Iterator[bytes]) -> None:
        """Unpack a tar in a folder; see `ContainerFiles.copy_into`."""
        folder, found = self._walk(folder, follow=True)
        part = self._part(folder)
        if found is None or found.kind != "d":
            raise UsageError(f"there is no folder {folder} in {self._container}", code=Code.NO_FILE)
        if not part.writable:
            raise self._refused(folder, "it is there to be read only", "copy into a volume that it may write to")
        there = _There(self, part, folder)
        script = inside(part.root, part.below(folder), _GNU + _UNTAR, part.root, way="rw")
        streams = self._session.open_shell(ending(_ROOT + script))
        given(self._session.host, streams, folder, _WHY, written_anew(tar, there.check))

    def _walk(self, path: str, *, follow: bool) -> tuple[str, Found | None]:
        """Return where a path leads in the container, by no link, and what is there; the last link only if asked."""
        return self._walked.to(self._view, path, follow=follow)

    def _part(self, path: str) -> Part:
        return self._part_of(self._view, path)

    def _part_of(self, view: View, path: str) -> Part:
        """Return what a path lies in; raises RefusedError when its engine alone could read that."""
        if part := view.part_of(path):
            return part
        if over := view.mounted_over(path, "/"):
            raise self._refused(path, f"what is mounted at {over} cannot be read by a path of the robot", UPDATE)
        why, do = "its files outside of volumes have no folder on the robot", UPDATE
        if not self._about.running:
            why = "it does not run, and others could lead its engine elsewhere"
            do = f"start it, copy what lies in a volume by its own path, or stop the others; or {UPDATE}"
        raise self._refused(path, why, do)

    def _look(self, path: str, names: Mapping[str, Collection[str]]) -> Mapping[str, Mapping[str, Found]]:
        """Ask the robot what is where; see `container_walk.Look`."""
        find = _FIND + LOOK
        scripts = [told(some, sandboxed(root, find, root)) for root, some in names.items()]
        return dict(zip(names, map(looked, self._asked(path, *scripts)), strict=True))

    def listed(self, part: Part, folder: str, what: str, depth: str) -> Mapping[str, bool]:
        """Return the paths below a folder that are there, and whether each is one."""
        find = f"find {quote(what)} {depth} -printf '%y%p\\0' 2>/dev/null | head -c {_MOST_LISTED} | base64 -w 0"
        (said,) = self._asked(folder, inside(part.root, part.below(folder), _IN + find, part.root))
        found = decoded(said)
        if len(found) == _MOST_LISTED:
            why = "more is there than can be compared"
            raise self._refused(folder, why, f"copy into a folder below it; or {UPDATE}")
        return {text_of(one[1:]).removeprefix("./"): one[:1] == b"d" for one in found.split(b"\0") if one}

    def refuse_mounted(self, path: str, folder: str) -> None:
        """Refuse a path below a folder where something else is mounted, which would stay as it is."""
        if over := self._view.mounted_over(path, folder):
            why = f"{over} is mounted in {folder}, and would not get it"
            do = f"copy what it is to get by a path in {over}; or {UPDATE}"
            raise self._refused(path, why, do if self._part(over).name == "" else UPDATE)

    def _asked(self, path: str, *scripts: str) -> list[str]:
        replies = self._session.ask([Query(command=_ROOT + one, timeout_s=_LISTING_S) for one in scripts])
        if failing := next((one for one in replies if not one.ok), None):
            raise failed(self._session.host, f"{path[:_SHOWN]} cannot be looked at", failing.status, failing.err, _WHY)
        return [one.out for one in replies]

    def _refused(self, path: str, why: str, hint: str) -> RefusedError:
        where = f"{path[:_SHOWN]} of {self._container} on {self._session.host} cannot be copied"
        return RefusedError(visible(f"{where}: {why}"), hint=hint, code=Code.ENGINE)


class _There:
    """What lies where something is unpacked: no folder takes a place of a file, and no file that of a folder."""

    def __init__(self, files: FolderFiles, part: Part, folder: str) -> None:
        self._files, self._part, self._folder = files, part, folder
        self._known: dict[str, bool] = {}
        self._tops: set[str] = set()
        """Whose content is known, too; nothing is at first."""

    def check(self, parts: list[str], is_folder: bool) -> None:
        """Refuse a place in the tar; see `container_tar.Check`."""
        path = posixpath.join(self._folder, *parts)
        self._files.refuse_mounted(path, self._folder)
        for end in range(1, len(parts) + 1):
            there = self._is_folder(parts[:end])
            if there is None:
                return
            if there != (is_folder or end < len(parts)):
                where = posixpath.join(self._folder, *parts[:end])
                what = ("a folder is there, where a file" if there else "no folder is there, where one") + " is to be"
                raise UsageError(visible(f"{where}: {what}"), code=Code.IN_THE_WAY)

    def _is_folder(self, parts: list[str]) -> bool | None:
        """Return whether a folder is at a place; None: nothing is."""
        if not self._tops:
            self._tops.add(".")
            self._known |= self._files.listed(self._part, self._folder, ".", "-mindepth 1 -maxdepth 1")
        top = parts[0]
        if len(parts) > 1 and top not in self._tops:
            self._tops.add(top)
            self._known |= self._files.listed(self._part, self._folder, f"./{top}", "")
        return self._known.get("/".join(parts))
