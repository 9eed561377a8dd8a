"""Text of an inventory that its reader does not see as srprov reads it.

Takes a text, the first line of a program, or the name of a file; raises, or tells. Reads the lists by which file
managers hide files. An inventory may run a program here, so its user looks at it first. A character that ends a line to
a parser, and to no editor, makes a setting of what stands in a comment; one that moves a terminal's cursor, or turns
the writing around, hides one; so do blanks, behind which it stands beside the window, whatever character shows as one,
and empty lines, behind which it stands below it. A setting behind a `#` in a quoted text is seen as a comment. A file
that shows data may be a program by its first line; and one that is not shown among the others is not looked at at all.
"""

from __future__ import annotations

import os
import re
import unicodedata

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc.nodes import Map, Node, Seq

_UNSEEN = re.compile(
    "\r(?!\n|\\Z)|\x0c(?![\r\n]|\\Z)|[\x01-\x08\x0b\x0e-\x1f\x7f-\x9f]"
    "|[\u061c\u2028-\u202e\u2066-\u2069]|[\U000e0000-\U000e007f]"
)
"""Control characters but tabs and ends of lines; a form feed may end a line, as that of a page.

A NUL ends and hides nothing; what is read has none anyway.
"""
_BESIDE = re.compile(" {100}")
_BELOW = 50
_EMPTY = frozenset("\u115f\u1160\u2800\u3164\uffa0\U00013441\U00013442\U0001d159")
"""Letters and signs that show nothing; so do all of the kinds in `_KINDS`, or nothing without a letter before them."""
_KINDS = ("Zs", "Cf", "Cn", "Mn", "Me")
_TAB, _WIDE = " " * 8, "  "
_COMMENT = re.compile(r"(?:^|\s)#")
_DATA = (".yml", ".yaml", ".json", ".ini", ".cfg", ".toml")
_COPIES = ("~", "%", ".bak", ".old", ".sik", ".pyc", ".pyo")
_OF_TOOLS = frozenset({"CVS", "_svn", "__pycache__", "Thumbs.db", "vssver.scc", "vssver2.scc"})
"""What GNOME Files, Nemo, Caja, Dolphin, VS Code and PyCharm leave out of a folder as they are installed."""
_LIST, _LONGEST_LIST = ".hidden", 1 << 20
_FIRST_LINE = re.compile(r"#! ?/[!-~][ -~\t]*\r?")


def check(text: str, path: str) -> None:
    """Refuse a text with such a character, a hundred blanks before something, or fifty empty lines, or without a name.

    Raises:
        DefinitionError: It names the place.
    """
    if any(stem and not blank(stem).strip() for stem in (part.split(".")[0] for part in path.split("/"))):
        message = "is a file, or lies in a folder, whose name shows nothing"
        raise _refused(path, 1, 1, message, "look at the folder with `ls -b | cat -A`, and give it a name")
    if found := _UNSEEN.search(text):
        before = text[: found.start()]
        shown = found[0].encode("unicode_escape").decode()
        message = f"has the character {shown} here: what stands around it may be read otherwise than it is seen"
        hint = "look at it with `cat -A`; lines end with a line feed, and there is no other such character"
        raise _refused(path, before.count("\n") + 1, found.start() - before.rfind("\n"), message, hint)
    empty = 0
    for number, line in enumerate(text.split("\n"), 1):
        if not (seen := blank(line).rstrip()):
            empty += 1
            continue
        if found := _BESIDE.search(seen):
            message = "has so many blanks that what stands behind them is not seen in many a window"
            raise _refused(path, number, found.start() + 1, message, "take them away")
        if empty >= _BELOW:
            message = "has so many empty lines before it that it is not seen in many a window"
            raise _refused(path, number, 1, message, "take them away")
        empty = 0


def blank(line: str) -> str:
    """Return a line with blanks, as many as it may show, for each tab, and for all else that shows nothing."""
    return _with_blanks(line, _WIDE).replace("\t", _TAB)


def _with_blanks(line: str, blanks: str) -> str:
    for one in () if line.isascii() else set(line) - {" "}:
        if one in _EMPTY or unicodedata.category(one) in _KINDS:
            line = line.replace(one, blanks)
    return line


def check_keys(root: Node | None) -> None:
    """Refuse a document that has a key behind a `#`, which is a part of a quoted text there: it looks like a comment.

    Raises:
        DefinitionError: It names the place.
    """
    left = [root] if root is not None else []
    comments: dict[int, int] = {}  # a program writes all robots in one line: it is looked at once, not for each key
    while left:
        node = left.pop()
        for key in node.keys.values() if isinstance(node, Map) else ():
            if key.line not in comments:
                comments[key.line] = _comment_in(key.source.excerpt(key.line))
            if comments[key.line] < key.column:
                message = "stands behind a '#', which begins no comment here: it is a part of a quoted text"
                raise _refused(key.source.file, key.line, key.column, message, "write each value on a line of its own")
        left += node.entries.values() if isinstance(node, Map) else node.items if isinstance(node, Seq) else ()


def _comment_in(line: str) -> int:
    """Return the column of what looks like the beginning of a comment; of none, the one behind the line."""
    found = _COMMENT.search(_with_blanks(line, " "))  # one for each character: columns stay as they are
    return found.end() if found else len(line) + 1


def check_program(path: str, first_line: str) -> None:
    """Refuse a program that its reader takes for data: by its name, or by a first line that does not name what runs it.

    Raises:
        DefinitionError: It is such a file.
    """
    if path.lower().endswith(_DATA):
        message = "could be run, and begins as a program does, but it is called as a file of data"
        raise _refused(path, 1, 1, message, "take its first line away, or `chmod -x`; a program has another name")
    if not first_line.startswith("#!"):
        return  # a binary, which nobody takes for data
    check(first_line, path)
    if not _FIRST_LINE.fullmatch(first_line):
        message = "could be run, and its first line does not begin with the whole path of what runs it"
        raise _refused(path, 1, 1, message, "write `#!/path/of/program`; if it is no program, `chmod -x`")


def is_shown(name: str) -> bool:
    """Return whether file managers and editors show a file, or folder, of this name among the others."""
    return not (name.startswith(".") or name.endswith(_COPIES) or name in _OF_TOOLS)


def shown(path: str, folder: str) -> str:
    """Return a path below a folder where no list of what is hidden there, which file managers go by, has a part of it.

    Raises:
        DefinitionError: One has, or may have: it cannot be read.
    """
    here = folder
    for part in os.path.relpath(path, folder or os.curdir).split(os.sep):
        listing = os.path.join(here, _LIST)
        try:
            listed = os.fsdecode(regular_file.read(listing, _LONGEST_LIST)).split("\n")
        except (FileNotFoundError, IsADirectoryError):
            listed = []
        except OSError as error:
            raise _refused(listing, 1, 1, f"cannot be read: {error.strerror}", "remove it") from None
        if part in listed:
            message = f"is not shown by file managers, as {os.path.relpath(listing)} lists '{part}'"
            raise _refused(path, 1, 1, message, "look at the file, then take the line away")
        here = os.path.join(here, part)
    return path


def _refused(path: str, line: int, column: int, message: str, hint: str) -> DefinitionError:
    return DefinitionError([Diagnostic(Location(path, line, column), message, hint=hint, code=Code.INVENTORY)])
