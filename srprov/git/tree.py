"""What a commit holds: files and links, and a refusal of what a folder of an image's context cannot have.

Takes what `git ls-tree` prints; gives entries. Pure. Git lets a tree say nearly anything: names that lead elsewhere,
one name twice, links to any place. A stranger's tree is held to what a plain folder holds.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from srprov.git.program import GitError

MOST_FILES = 20_000
_MOST_LINKS = 40
"""That one path may lead over."""
_LONGEST_PATH = 1000
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


@dataclass(frozen=True, slots=True)
class Entry:
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
        if mode not in (_FILE, _PROGRAM, _OLD_FILE, _LINK) or not size.isdigit():
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
    parts = path.split("/")
    strange = any(part in ("", ".", "..") or part.lower() == ".git" for part in parts)
    if strange or len(path) > _LONGEST_PATH or any(ord(character) < 32 or character == "\x7f" for character in path):
        raise GitError(f"it holds {path[:100]!r}, which no folder can have")
    return path


def _check_folders(paths: Collection[str]) -> None:
    """Refuse what stands twice, and what lies below a file or a link."""
    known = set(paths)
    if len(known) != len(paths):
        raise GitError("it holds a name twice")
    for path in paths:
        above = path.rpartition("/")[0]
        while above:
            if above in known:
                raise GitError(f"it holds {path} below {above}, which is no folder")
            above = above.rpartition("/")[0]


def check_links(links: Mapping[str, bytes]) -> None:
    """Refuse links that lead out of the tree.

    Args:
        links: Path -> where it leads, of every link of the tree.

    Raises:
        GitError: Names the first.
    """
    targets = {path: content.decode("utf-8", "surrogateescape") for path, content in links.items()}
    for path in sorted(targets):
        if "\0" in targets[path] or not _stays(path, targets):
            raise GitError(f"the link {path} leads out of the repository")


def _stays(path: str, targets: Mapping[str, str]) -> bool:
    """Walk a path as the kernel does; return whether it stays within the tree all the way."""
    ahead, behind, followed = path.split("/")[::-1], [], 0  # type: list[str], list[str], int
    while ahead:
        part = ahead.pop()
        if part in ("", "."):
            continue
        if part == "..":
            if not behind:
                return False
            behind.pop()
            continue
        behind.append(part)
        target = targets.get("/".join(behind))
        if target is not None:
            followed += 1
            if target.startswith("/") or not target or followed > _MOST_LINKS:
                return False
            behind.pop()
            ahead += target.split("/")[::-1]
    return True
