"""A tar from a container -> files here, none of them outside of the place that the user named.

Takes pieces of a tar that a stranger's container filled, and a folder. Every folder on the way is opened by its
descriptor and no link is followed: neither `..`, nor a link in the tar, nor one that is here already leads elsewhere.
A file comes under another name beside its place and takes it when it is whole. A link, or a second name, comes as a
file of its own, where it leads to a file that came; devices, pipes and sockets do not come.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import tarfile
from collections.abc import Iterator

import msgspec

from srprov.codes import Code
from srprov.controller.copied import Copied
from srprov.controller.copied_links import Links, stays_inside
from srprov.controller.folder_entries import is_folder, make_like, open_file, open_folder
from srprov.errors import UsageError, visible
from srprov.transport.tar_stream import TarError, TarStream, parts_of, place_of

MOST_MEMBERS = 200_000
_MOST_BYTES = 64 << 30
"""Of a copy with what links lead to, which a container names as often as it likes."""
_LEFT_FREE, _LOOK = 512 << 20, 32 << 20
"""Bytes of the disk that no copy takes, and between two looks at it."""
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
_PIECE = 1 << 20
_Like = tuple[int, float | None]
"""Permissions and time."""


class Target(msgspec.Struct, frozen=True, kw_only=True):
    """Where a copy goes on this machine."""

    folder: str
    """It is there; a link to it is followed."""
    name: str
    """What the copy is called in it; empty: what is copied is a folder, and its content goes into this one."""


def unpack(chunks: Iterator[bytes], target: Target, copied: Copied, *, preserve: bool) -> None:
    """Write what a tar holds: one file, or one folder with all below it.

    Args:
        chunks: The tar.
        target: Where it goes.
        copied: Is told what was done.
        preserve: Keep permissions and times; else files are their owner's alone, and executable where they were.

    Raises:
        UsageError: The tar is none, or something that is here is in the way.
        OSError: Something cannot be written.
    """
    tar = TarStream(chunks, most_members=MOST_MEMBERS, any_kind=True)
    try:
        with _Tree(target, copied, preserve) as tree:
            for header in tar:
                tree.add(header, tar.content())
            tree.finish()
    except TarError as error:
        raise UsageError(f"what the container's engine sends is not understood: {error}", code=Code.ANSWER) from error


class _Tree:
    """The copy; it holds the folders that lead to where it writes, from the user's own on."""

    def __init__(self, target: Target, copied: Copied, preserve: bool) -> None:
        self._target, self._copied, self._preserve = target, copied, preserve
        self._open: list[tuple[str, int, _Like | None]] = []
        """Name and descriptor of each folder on the way, and what it is to be like; the first is the user's."""
        self._top: list[str] | None = None
        """What all names in the tar begin with."""
        self._written: set[str] = set()
        self._came: set[str] = set()
        """Folders of the copy."""
        self._folders: dict[tuple[str, ...], _Like] = {}
        """What folders are to be like once nothing more is written there."""
        self._links = Links()
        self._unlooked = 0
        """Bytes since the disk was looked at."""

    def __enter__(self) -> _Tree:
        folder = os.open(self._target.folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._open.append(("", folder, None))
        return self

    def __exit__(self, *_error: object) -> None:
        self._leave(0)

    def add(self, header: tarfile.TarInfo, content: Iterator[bytes]) -> None:
        """Write one member."""
        parts = self._place(header.name)
        if self._copied.leave_repository(parts, self._above, folder=header.isdir()):
            return
        if header.isdir():
            self._enter(parts)
            self._came.add("/".join(parts))
            if self._preserve:
                self._folders[tuple(parts)] = header.mode, header.mtime
            return
        if not parts:
            raise UsageError("what is to be copied is neither a file nor a folder", code=Code.NO_FILE)
        folder = self._enter(parts[:-1])
        if header.isreg():
            self._file(folder, parts, header, content)
        elif header.issym() and stays_inside(len(parts) - self._above - 1, header.linkname):
            self._links.add("/".join(parts), header.linkname)
        elif header.issym():
            self._copied.leave_out("/".join(parts), f"a link that leads out of it, to {header.linkname}")
        elif header.islnk():
            self._hard_link(folder, parts, header)
        else:
            self._copied.leave_out("/".join(parts), "a device, pipe or socket")

    def finish(self) -> None:
        """Write what links lead to in their places, then give folders their permissions and times."""
        for place, link, end in self._links.all():
            *above, last = place.split("/")
            if end is not None and end in self._written:
                self._again(end.split("/"), self._enter(above), [*above, last])
            elif end in self._came:  # all that it leads to is here under its own name
                self._copied.leave_out(place, f"a link to a folder, {link}; a tar has it, with `-`", lost=False)
            else:
                self._copied.leave_out(place, f"a link to what did not come with it, {link}")
        self._leave(1)
        for parts, like in sorted(self._folders.items()):
            self._enter(list(parts), like)

    @property
    def _above(self) -> int:
        """How many folders of a place are not the container's."""
        return 1 if self._target.name else 0

    def _place(self, name: str) -> list[str]:
        """Return where a member goes, below the user's folder."""
        if self._top is None:
            self._top = parts_of(name)[:1]
        return place_of(name, self._top, self._target.name)

    def _enter(self, parts: list[str], like: _Like | None = None) -> int:
        """Return the descriptor of a folder, which is made when it is missing; leave those that do not lead there."""
        known = 0
        while known < min(len(parts), len(self._open) - 1) and self._open[known + 1][0] == parts[known]:
            known += 1
        self._leave(known + 1)
        for at, name in enumerate(parts[known:], known + 1):
            above = self._open[-1][1]
            if "/".join(parts[:at]) in self._links:
                raise TarError(f"{'/'.join(parts)[:80]!r} lies below a link")
            with contextlib.suppress(FileExistsError):
                os.mkdir(name, 0o700, dir_fd=above)
            descriptor = open_folder(name, above, os.path.join(self._target.folder, *parts[:at]))
            self._open.append((name, descriptor, like if at == len(parts) else None))
        return self._open[-1][1]

    def _leave(self, first: int) -> None:
        """Close folders from one on, and give each its permissions and time now that nothing more is written there."""
        while len(self._open) > first:
            _, descriptor, like = self._open.pop()
            try:
                if like is not None:
                    make_like(descriptor, *like)
            finally:
                os.close(descriptor)

    def _file(self, folder: int, parts: list[str], header: tarfile.TarInfo, content: Iterator[bytes]) -> None:
        like = (header.mode, header.mtime) if self._preserve else (0o600 | header.mode & 0o100, None)
        self._write(folder, parts, content, like)

    def _write(self, folder: int, parts: list[str], content: Iterator[bytes], like: _Like) -> None:
        """Write a file."""
        with (
            self._beside(folder, parts) as name,
            os.fdopen(os.open(name, _NEW, 0o600, dir_fd=folder), "wb") as stream,
        ):
            for piece in content:
                stream.write(piece)
                self._copied.bytes += len(piece)
                self._leave_room(stream.fileno(), len(piece))
            stream.flush()
            make_like(stream.fileno(), *like)
        self._copied.files += 1
        self._written.add("/".join(parts))

    def _again(self, first: list[str], folder: int, parts: list[str]) -> None:
        """Write a file that came under another name, too: it stays as it is, whatever takes the first one's place."""
        try:
            found = open_file(first, self._open[0][1])
        except PermissionError:  # it has the permissions that it had there
            self._copied.leave_out("/".join(parts), "another name of a file that nobody may read")
            return
        with found as file:
            about = os.fstat(file.fileno())
            if self._copied.bytes + about.st_size > _MOST_BYTES:
                raise TarError(f"with what links lead to, it has more than {_MOST_BYTES >> 30} GiB")
            pieces = iter(lambda: file.read(_PIECE), b"")
            self._write(folder, parts, pieces, (about.st_mode, about.st_mtime if self._preserve else None))

    def _leave_room(self, descriptor: int, size: int) -> None:
        """Refuse (OSError) to fill the disk: a container may send files without end."""
        self._unlooked += size
        if self._unlooked >= _LOOK:
            self._unlooked = 0
            about = os.fstatvfs(descriptor)
            if about.f_bavail * about.f_frsize < _LEFT_FREE:
                raise OSError(errno.ENOSPC, f"less than {_LEFT_FREE >> 20} MiB would be free", self._target.folder)

    def _hard_link(self, folder: int, parts: list[str], header: tarfile.TarInfo) -> None:
        """Write a file under its second name; it must have come in this copy, and nothing may have taken its place."""
        first = self._place(header.linkname)
        if "/".join(first) not in self._written:
            raise TarError(f"{header.name[:80]!r} is another name of what did not come")
        if "/".join(first) in self._links:
            raise TarError(f"{header.name[:80]!r} is another name of what is no file")
        self._again(first, folder, parts)

    @contextlib.contextmanager
    def _beside(self, folder: int, parts: list[str]) -> Iterator[str]:
        """Give a name for what is made in the block; when it is whole, it takes the place of what is there."""
        name = f".srprov-{secrets.token_hex(8)}.part"
        try:
            yield name
            if is_folder(folder, parts[-1]):
                where = visible(os.path.join(self._target.folder, *parts))
                raise UsageError(f"{where}: a folder is there, where a file is to be", code=Code.IN_THE_WAY)
            os.rename(name, parts[-1], src_dir_fd=folder, dst_dir_fd=folder)
        finally:
            with contextlib.suppress(OSError):  # it is there when something failed, or was the same file already
                os.unlink(name, dir_fd=folder)
