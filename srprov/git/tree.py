"""What a commit holds: files and links, and a refusal of what a folder of an image's context cannot have.

Takes what `git ls-tree` prints; gives entries. Pure. Git lets a tree say nearly anything: names that lead elsewhere,
one name twice, links to any place. A stranger's tree is held to what a plain folder holds.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import msgspec

from srprov.git.program import GitError
from srprov.tree_links import leaving

MOST_FILES = 20_000
_LONGEST_PATH = 1000
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
_LONGEST_TARGET = 4095
"""Bytes of where a link leads, as Linux has it."""
_LISTED = re.compile(rb"([0-7]{6}) [a-z]+ ([0-9a-f]{40}|[0-9a-f]{64}) +([0-9]{1,15}|-)\t(.*)", re.DOTALL)
"""What `git ls-tree -l` prints for an entry: mode, object, size, name."""
_FILE, _PROGRAM, _OLD_FILE, _LINK, _SUBMODULE = "100644", "100755", "100664", "120000", "160000"


@dataclass(frozen=True, slots=True)
class TreeFile:
    """One file or link of a commit."""

    path: str
    content: bytes = field(repr=False)
    """Of a link: where it leads."""
    executable: bool = False
    is_link: bool = False


class Entry(msgspec.Struct, frozen=True):
    """One entry of a commit, whose content is not read yet."""

    path: str
    mode: str
    object: str
    size: int

    @property
    def is_link(self) -> bool:
        """Whether it is a symbolic link."""
        return self.mode == _LINK

    @property
    def executable(self) -> bool:
        """Whether it is a program."""
        return self.mode == _PROGRAM


def entries(listed: bytes, most: int, elsewhere: Collection[str] = ()) -> list[Entry]:
    """Read what `git ls-tree -r -z -l` prints.

    Args:
        listed: What was printed.
        most: Bytes that all files may have together.
        elsewhere: Paths of submodules that the user names as repositories of their own; they are left out.

    Raises:
        GitError: It holds what cannot be taken, or too much.
    """
    found: list[Entry] = []
    for line in listed.split(b"\0")[:-1]:
        match = _LISTED.fullmatch(line)
        if match is None:
            raise GitError(f"git lists {line[:100]!r}, which is no entry of a commit")
        mode, identity, size = (match[group].decode("ascii") for group in (1, 2, 3))
        path = _checked(match[4])
        if mode == _SUBMODULE:
            if path not in elsewhere:
                raise GitError(
                    f"it holds the submodule {path}, which is not fetched: name it as a repository of its own"
                )
            continue
        if mode not in (_FILE, _PROGRAM, _OLD_FILE, _LINK) or not size.isdecimal():
            raise GitError(f"{path} is no file and no link")
        found.append(Entry(path, mode, identity, int(size)))
    if len(found) > MOST_FILES or sum(one.size for one in found) > most:
        raise GitError(f"it holds more than {MOST_FILES} files or {most >> 20} MiB")
    if not found:
        raise GitError("it holds no file")
    _check_folders([one.path for one in found])
    return found


def _checked(name: bytes) -> str:
    try:
        path = name.decode("utf-8")
    except UnicodeDecodeError:
        raise GitError(f"it holds {name[:100]!r}, a name that is not UTF-8") from None
    low = f"/{path.lower()}/"
    strange = any(part in low for part in ("//", "/./", "/../", "/.git/"))
    if strange or len(path) > _LONGEST_PATH or _CONTROL.search(path):
        raise GitError(f"it holds {path[:100]!r}, which no folder can have")
    return path


def _check_folders(paths: Collection[str]) -> None:
    """Refuse what stands twice, and what lies below a file or a link."""
    if len(set(paths)) != len(paths):
        raise GitError("it holds a name twice")
    # NUL sorts before all that a name may hold, so what lies below a file comes right after it
    sorted_paths = sorted(path.replace("/", "\0") for path in paths)
    for above, path in itertools.pairwise(sorted_paths):
        if path.startswith(f"{above}\0"):
            shown, folder = (one.replace("\0", "/") for one in (path, above))
            raise GitError(f"it holds {shown} below {folder}, which is no folder")


def check_links(links: Mapping[str, bytes]) -> None:
    """Refuse links that lead out of the tree.

    Args:
        links: Path -> where it leads, of every link of the tree.

    Raises:
        GitError: Names the first.
    """
    if path := next((path for path, content in sorted(links.items()) if not 0 < len(content) <= _LONGEST_TARGET), ""):
        raise GitError(f"the link {path} leads out of the repository: no folder can have it")
    try:
        path = leaving({path: content.decode("utf-8", "surrogateescape") for path, content in links.items()})
    except ValueError as error:
        raise GitError(str(error)) from None
    if path:
        raise GitError(f"the link {path} leads out of the repository")
