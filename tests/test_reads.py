"""Files that others wrote are read through srprov/regular_file.py, which takes no pipe, no device and nothing endless.

Everything is read with `ast`. Whoever reads a file in another way adds a line here, with the reason why it cannot be
somebody else's.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping

from tests.test_rooms import name_of, sources

READS = frozenset({"open", "read_text", "read_bytes"})
NO_FILES = frozenset(
    {"tarfile.open", "loader.read_text", "regular_file.read_text", "os.open", "io.open", "opener.open"}
)
"""Attributes that are called like those of a Path; `os.open` and `io.open` are told by their own names."""

HERE_DOCUMENT = re.compile(r"<<-?[ \t]*(?:['\"\\]?[A-Za-z_]|\{)")

OWN: Mapping[str, str] = {
    "regular_file.py": "this is where files are read",
    "data.py": "schemas that ship with srprov",
    "explaining/": "pages that ship with srprov",
    "controller/playbooks.py": "playbooks that ship with srprov",
    "probing/script.py": "the programs that ship with srprov",
    "controller/copied_out.py": "opens folders to write into them, and files that it makes itself",
    "controller/folder_entries.py:open_folder": "a folder, only to write into it",
    "controller/folder_entries.py:open_file": "what copied_out.py put there right before: a plain file, by no link",
    "controller/trial_folder.py:alone": "a folder, only to lock it",
    "git/cache.py:locked": "a lock of its own, only to write",
    "definitions/schema_cache.py": "the user's own cache: nobody else can write there, or it is not used",
    "rendering/compiled.py": "the user's own cache: nobody else can write there, or it is not used",
    "rendering/limited.py": "a pipe of its own, and a file of the kernel's",
    "believed.py": "reads what is the user's own, where nobody else can write",
    "private.py": "writes files of its own, for their owner alone",
    "record/journal.py": "the run's own journal, in a folder that nobody else can write to, and no link",
    "record/results.py": "what was written right before, into a folder of its own",
    "record/recordings.py": "what results.py put there right before, a few bytes of each",
    "record/mcap.py": "what results.py put there right before, a piece at a time",
    "datasets.py:keep": "writes a download of its own, into the user's own cache",
    "record/folder.py": "writes the run's record, into a new folder",
    "transport/blob.py": "the user's own cache: what a file holds is compared with the digest in its name",
    "transport/blobs.py": "writes the user's own cache",
    "transport/openssh/algorithms.py": "a file of the kernel's",
    "transport/openssh/host_keys.py:_append": "writes the key of a new robot",
    "cli/streams.py": "/dev/null",
    "cli/output_options.py": "opens what was asked for only to write, and only a regular file",
    "exporting/folder.py": "writes the export, into a new folder",
    "lab/": "the lab's own files and the kernel's, on this machine, as root",
}
"""File, `file:function` or room -> why what it opens is not foreign."""

NO_FILE_AT_ALL = ("transport/",)
"""Where `open` is also what begins a connection, a channel or a stream; only the builtin counts there."""


def reads(path: str, source: str) -> list[str]:
    """List, as `file:line: what`, where a file is opened or read in another way; `path` is as below `srprov/`."""
    tree = ast.parse(source, filename=path)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not (what := _reads(path, node)):
            continue
        inside = {one.name for one in functions if one.lineno <= node.lineno <= (one.end_lineno or one.lineno)}
        if not any(_excuses(key, path, inside) for key in OWN):
            found.append(f"srprov/{path}:{node.lineno}: {what}: read it through srprov/regular_file.py")
    return found


def _reads(path: str, node: ast.Call) -> str:
    name = name_of(node.func)
    if name in ("open", "os.open", "io.open", "os.fdopen", "codecs.open", "fileinput.input"):
        return name
    if isinstance(node.func, ast.Attribute) and node.func.attr in READS and name not in NO_FILES:
        return "" if path.startswith(NO_FILE_AT_ALL) and node.func.attr == "open" else node.func.attr
    if name == "tarfile.open" and not any(keyword.arg == "fileobj" for keyword in node.keywords):
        return name
    return ""


def _excuses(key: str, path: str, functions: set[str]) -> bool:
    file, _, function = key.partition(":")
    return path.startswith(file) if file.endswith("/") else path == file and (not function or function in functions)


def test_every_foreign_file_is_read_through_the_one_place_with_limits() -> None:
    found = [line for path, source in sources().items() for line in reads(path, source)]
    assert not found, "\n".join(found)


def test_every_excuse_still_has_its_file() -> None:
    paths = sources()
    assert [key for key in OWN if not any(_excuses(key, path, {key.partition(":")[2]}) for path in paths)] == []


def test_the_checker_sees_each_way_to_read() -> None:
    ways = [
        "open(path)",
        "Path(path).read_text()",
        "path.read_bytes()",
        "path.open('rb')",
        "os.open(path, 0)",
        "io.open(path)",
        "(folder / name).read_text()",
        "tarfile.open(path)",
    ]
    assert [len(reads("definitions/x.py", way)) for way in ways] == [1] * len(ways)
    assert len(reads("transport/x.py", "with open(file) as stream: pass")) == 1
    fine = ["regular_file.read(path)", "tarfile.open(fileobj=buffer)", "loader.read_text(path)"]
    assert [reads("definitions/x.py", way) for way in fine] == [[], [], []]
    assert reads("transport/x.py", "self._link.open(3)") == []


def test_no_script_has_root_make_a_file_where_others_on_a_robot_write() -> None:
    """A container may mount the robot's /tmp, and put a link in the place of what mktemp made there."""
    assert [path for path, source in sources().items() if "$(mktemp" in source] == []


def test_no_script_has_a_here_document() -> None:
    """A shell may keep it in a file in /tmp, and open that by its name; bash does."""
    found = [
        f"{path}:{node.lineno}"
        for path, source in sources().items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.JoinedStr | ast.Constant) and HERE_DOCUMENT.search(ast.unparse(node))
    ]
    assert found == []
