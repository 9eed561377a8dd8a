"""Paths that a user's file names -> absolute paths that exist and stay where they may.

Takes the scalar that holds the path; gives an absolute real path, or adds a problem and gives "". Touches the file
system, for looking only. A file may name what lies below the experiment's folder; one that itself lies elsewhere (a
CDF shared by several experiments) may name what lies below its own folder. Symbolic links count as what they lead to,
also inside a folder.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.homes import homes_in
from srprov.definitions.version_control import is_from_elsewhere, is_kept
from srprov.definitions.ways import Ends, way_to
from srprov.yamldoc import nodes
from srprov.yamldoc.allowance import Allowance, Left, current
from srprov.yamldoc.nodes import Findings, Path, Scalar

_MOST_FILES = 20_000
_MOST_BYTES = 96 * 1024 * 1024
"""Of one file or folder that is shipped: it is held in memory, and goes to each robot over SSH. See disk.py."""
_DEEPEST = 50
"""Folders in each other that are shipped: each file's path is looked at many times, and each time all of it."""
_SHIPPED_HINT = f"a file or folder that is shipped holds at most {_MOST_FILES} files and {_MOST_BYTES >> 20} MiB"


def shown_beside(shown: str, relative: str) -> str:
    """Name a file as the user would, from the name of the file that mentions it."""
    return os.path.normpath(os.path.join(os.path.dirname(shown), relative))


def inside(path: str, folder: str) -> bool:
    """Return whether a path, links followed, lies in a folder (or is it)."""
    return _is_below(os.path.realpath(path), os.path.realpath(folder))


def belongs(path: str, folder: str) -> bool:
    """Return whether a path, links followed, lies in a folder, and is not what people's programs keep there.

    That is what version control has, and what lies in a home, or holds one: where the folder is a home, all.
    """
    real, root = os.path.realpath(path), os.path.realpath(folder)
    if not _is_below(real, root) or root == os.sep:
        return False
    of_home = any(_is_below(real, home) or _is_below(home, real) for home in homes_in(root))
    return not of_home and not is_kept(real, root)


def _is_below(real: str, root: str) -> bool:
    return real == root or real.startswith(root.rstrip("/") + "/")


def link_out(path: str) -> str:
    """Return the first link named in a relative path that leads out of the folder in which it lies, or nothing.

    With a project that was cloned come links of a stranger's: what a user means by a name in it lies there, and not in
    what version control keeps. A path from the root is taken as it is.
    """
    return next((one for one in regular_file.links_in(path) if not lies_open(one, os.path.dirname(one))), "")


def lies_open(path: str, folder: str) -> bool:
    """Return whether a path, links followed, lies in a folder, and not in what version control keeps there."""
    return inside(path, folder) and not is_kept(os.path.realpath(path), os.path.realpath(folder))


def way_out(path: str) -> str:
    """Return the first link named in a relative path by which it leads out of this very folder, or nothing."""
    return link_out(path) if not inside(path, os.curdir) else ""


def folder_of(path: str) -> str:
    """Return the folder in which a file lies by its name; of one that a link leads to from elsewhere, that link's."""
    return os.path.dirname(os.path.abspath(link_out(path) or path))


def root_for(folder: str, experiment_folder: str) -> str:
    """Return the folder that files named in `folder` must not leave."""
    return experiment_folder if inside(folder, experiment_folder) else folder


def is_closed(path: str) -> bool:
    """Return whether a file or folder is not the experiment's own while nobody has allowed to look at such ones yet.

    It is asked for. Before, nothing is told of it, not even whether it is there.
    """
    limits = current.get()
    if limits is None or not limits.homes:
        return False
    return not any(way_to(path, home).ends is Ends.INSIDE and belongs(path, home) for home in limits.homes)


def is_left(node: Scalar, path: str, at: Path) -> bool:
    """Return whether a file that a scalar names, to be read, is closed, and note it, then."""
    limits = current.get()
    if limits is None or not is_closed(path):
        return False
    message = f"'{node.text[:80]}' is not the experiment's own: it is not looked at without `--allow outside`"
    whose = str(at[1]) if at[:1] == ("services",) else ""
    limits.left.append(Left(path, whose, nodes.problem(node, message, at, code=Code.OUTSIDE)))
    return True


def named(node: Scalar) -> str:
    """Return the absolute path that a scalar names relative to its own file: whoever reads or judges it takes this one.

    `..` is taken out of the text first. The kernel would go by the links before it, to another file.
    """
    return os.path.normpath(os.path.join(node.source.folder, node.text))


def resolve(node: Scalar, experiment_folder: str, findings: Findings, path: Path, *, tree: bool = False) -> str:
    """Return the absolute real path that a scalar names relative to its own file; with `tree`, check links in it too.

    An absolute or `~` path is refused: what is shipped must lie with the experiment. What is closed is not looked at.
    """
    text = node.text
    if "\0" in text or os.path.isabs(text) or text.startswith("~"):
        findings.add(node, f"'{text[:80]}' must be a relative path in the experiment's folder", path, code=Code.OUTSIDE)
        return ""
    folder = node.source.folder
    root, meant = root_for(folder, experiment_folder), named(node)
    if not _is_below(meant, os.path.abspath(root)):
        meant = os.path.normpath(os.path.join(os.path.realpath(folder), text))  # by links that led to the file itself
    way = way_to(meant, root).ends
    if way in (Ends.INSIDE, Ends.KEPT) and is_closed(meant):
        return meant
    # looked up once: what is checked here is what is read later, by a path without links
    code, real = Code.NO_SUCH_FILE, os.path.realpath(meant) if way in (Ends.INSIDE, Ends.KEPT) else ""
    if way is Ends.STRANGE:
        wrong, hint = "leads by a link that has another name, elsewhere (a hard link)", "make that link anew"
    elif not real or not inside(real, root):
        wrong, hint, code = (
            f"leaves the folder {shown_folder(root)}",
            "copy it into the experiment's folder",
            Code.OUTSIDE,
        )
    elif not os.path.exists(real):
        wrong, hint = "does not exist", f"it is looked for in {shown_folder(folder)}"
    elif tree and (fault := _fault_below(real, root)):
        wrong, hint = fault, _SHIPPED_HINT
    elif not _utf8(real):
        wrong, hint = "leads to a name that is not UTF-8", "engines take no such name; rename it"
    else:
        return real
    findings.add(node, f"'{text}' {wrong}", path, hint, code=code)
    return ""


def _utf8(path: str) -> bool:
    """Return whether a path of the file system is text: Python has other bytes as halves of surrogate pairs."""
    return not any("\ud800" <= character <= "\udfff" for character in path)


def shown_folder(folder: str) -> str:
    """Return a folder as it is shown: relative to the current folder when that is shorter."""
    relative = os.path.relpath(folder)
    return "here (.)" if relative == "." else min(relative, folder, key=len)


def _fault_below(path: str, root: str) -> str:
    """Return why a file or folder cannot be shipped, or nothing; a link in it must not lead out of `root`.

    Each is walked through once, however often it is named.
    """
    left = current.get() or Allowance(0, 0)
    if (path, root) not in left.walked:
        left.walked[path, root] = _fault_of_each(path, root, left)
    return left.walked[path, root]


def _fault_of_each(path: str, root: str, left: Allowance) -> str:
    size, inner = 0, os.path.realpath(root)
    for count, full in enumerate(_files_below(path)):
        left.files -= 1
        if full.count(os.sep) - path.count(os.sep) > _DEEPEST:
            return f"holds more than {_DEEPEST} folders in each other"
        try:
            about = os.lstat(full)
        except OSError as error:
            return f"cannot be read: {error.strerror}"
        if stat.S_ISLNK(about.st_mode):
            # one that an archive gave this name is asked for: nothing is told of where it leads
            if not is_from_elsewhere(about, inner) and not _is_below(os.path.realpath(full), inner):
                return f"holds a link that leaves the folder {shown_folder(root)}: {os.path.relpath(full, path)}"
        elif stat.S_ISREG(about.st_mode):
            size += about.st_size
        elif not stat.S_ISDIR(about.st_mode):
            shown = os.path.relpath(full, path)
            return "is no file, folder or link" if shown == "." else f"holds what is no file, folder or link: {shown}"
        if count > _MOST_FILES or size > _MOST_BYTES:
            return f"holds more than {f'{_MOST_FILES} files' if count > _MOST_FILES else f'{_MOST_BYTES >> 20} MiB'}"
        if left.files < 0:
            return "holds, with all else that is shipped, more files than an experiment may"
    return ""


def _files_below(path: str) -> Iterator[str]:
    """Return a path, what it leads to when it is a link, and all below it."""
    yield os.path.realpath(path)
    for parent, folders, files in regular_file.walk(path):
        folders.sort()
        yield from (os.path.join(parent, name) for name in sorted([*folders, *files]))
