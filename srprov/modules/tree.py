"""Files and folders of the experiment that are shipped to a robot, by content, read-only.

The name is `STATE_ROOT/<instance>/trees/<hash>`. The
path holds the content's hash and appears by one rename, so that being there means being right.
"""

from __future__ import annotations

import functools
import hashlib
import posixpath
import re
from collections.abc import Mapping, Sequence

import msgspec

from srprov import plain_tar
from srprov.modules.differences import read_start, text_difference
from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT, Module, Names
from srprov.resource import Action, Change, Difference, Observed, State
from srprov.robot_answers import all_lines
from srprov.untrusted import lines_of
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_PARTS = 3
_MOUNTED = re.compile(rf"bind ({STATE_ROOT}/[^/\0]+/trees/[0-9a-f]{{24}})/([^/\0]+) \(read-only\)")
_MOST_LISTED = 256 << 10
"""Bytes of the list of an old tree's files."""
_MOST_LINES = _MOST_LISTED // (hashlib.sha256().digest_size * 2)
"""Each has a hash; names may have line feeds, which `sha256sum` escapes."""
_MOST_NAMED = 8


class TreeParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a tree."""

    blob: bytes
    """A tar whose single top entry is the file or folder."""


class TreeModule(Module[TreeParams]):
    """The module of kind `tree`."""

    kind = "tree"
    params = TreeParams
    root = STATE_ROOT

    def queries(self) -> tuple[AnyQuery, ...]:
        """List the shipped trees of every instance."""
        return (
            Query(
                command=f'for d in {STATE_ROOT}/*/trees/*; do [ -e "$d" ] && printf "%s\\n" "$d"; done; :',
                in_place=True,
            ),
        )

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read one path per line; half-extracted ones (`.part`, `.tar`) are the instance's too and are cleaned up."""
        found = []
        for line in all_lines(replies[0].out):
            parts = line.removeprefix(STATE_ROOT + "/").split("/")
            if line.startswith(STATE_ROOT + "/") and len(parts) == _PARTS:
                found.append(Observed(module="tree", name=line, instance=parts[0], state={}))
        return tuple(found)

    def check(self, name: str, want: TreeParams, found: State | None) -> Change | None:
        """Ask only whether it is there; if not, send the tar, unpack it beside the final place, rename."""
        if found is not None:
            return None
        tar, part, final = f"{name}.tar", f"{name}.part", name
        unpack = (
            f"rm -rf {quote(part)} && mkdir -p {quote(part)} && tar -xf {quote(tar)} -C {quote(part)} && "
            f"rm -f {quote(tar)} && chmod 0755 {quote(part)} && mv {quote(part)} {quote(final)}"
        )
        commands = (Put(path=tar, content=want.blob, mode=0o600, timeout_s=600), Run(script=unpack, timeout_s=600))
        top = top_of(want.blob)  # who wrote the EDF may have named any file beside it
        cause = f"{f'{top} is ' if top else ''}not shipped yet ({len(want.blob)} bytes)"
        return Change(action=Action.CREATE, cause=cause, commands=commands)

    def is_own(self, name: str, want: TreeParams, names: Names) -> bool:
        """Compare the name with the content's hash; and take only files and folders below one that is no link."""
        digest = plain_digest(want.blob)
        return bool(digest) and name == f"{STATE_ROOT}/{names.instance}/trees/{digest}"

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it and what is empty above it."""
        return (remove_path(found.name),)


@functools.lru_cache(maxsize=4096)  # many robots of a plan file may have one tree
def plain_digest(blob: bytes) -> str:
    """Return the hash that names a tree, or a volume's seed; "" for a tar that is not such as srprov ships.

    That is one file or folder, and nothing that could lie elsewhere: a mount of its top entry would follow a link there
    to any folder of the robot, and so would whatever lies below one.
    """
    try:
        members = list(plain_tar.members(blob))
        plain_tar.check_paths(members)
    except ValueError:
        return ""
    tops = [one for one in members if "/" not in one.path]
    if len(tops) != 1 or tops[0].link is not None or any(one.mode not in (0o644, 0o755) for one in members):
        return ""
    return hashlib.sha256(blob).hexdigest()[:24]


@functools.lru_cache(maxsize=4096)
def top_of(blob: bytes) -> str:
    """Return the name that a tar's file or folder had on the controller; "" for a tar that srprov does not ship."""
    try:
        return next(plain_tar.members(blob)).path.partition("/")[0]
    except (ValueError, StopIteration):  # of a plan file, which may hold anything
        return ""


def mounted_tree(value: str | None) -> tuple[str, str]:
    """Return the tree's name, and that of its top entry, of a mount as `container_values` tells it; or nothing."""
    match = _MOUNTED.fullmatch(value or "")
    return (match[1], match[2]) if match and match[2] not in (".", "..") else ("", "")


def content_queries(path: str) -> tuple[Query, Query]:
    """Return what to ask for the contents of a mounted file or folder: all hashes, and of a file its beginning."""
    word = quote(path)
    files = f"find {word} -type f -exec sha256sum {{}} + 2>/dev/null | head -c {_MOST_LISTED}; :"
    return Query(command=files), Query(command=f"[ -d {word} ] || {read_start(path).command}")


def content_difference(field: str, path: str, replies: Sequence[Reply], blob: bytes) -> Difference:
    """Return how a mounted file or folder differs from the tar that takes its place; `replies` are to the queries.

    Of a file it is a diff, of a folder the names of what is changed, new and gone.
    """
    try:
        members = [one for one in plain_tar.members(blob) if one.content is not None]
    except ValueError as error:  # of a plan file, which may hold anything
        return Difference(field=field, note=f"the new content is {error}")
    if len(members) == 1 and "/" not in members[0].path and not any(path + "/" in line for line in _lines(replies[0])):
        assert members[0].content is not None  # looked at above
        return text_difference(field, replies[1], members[0].content.decode("utf-8", "replace"))
    if len(replies[0].out.encode()) >= _MOST_LISTED or replies[0].out.count("\n") > _MOST_LINES or not replies[0].ok:
        return Difference(field=field, note="the old content was not read")
    lines = (line.partition("  ") for line in _lines(replies[0]))
    old = {posixpath.relpath(name, path): sha for sha, _, name in lines if name.startswith("/")}
    new = {one.path.partition("/")[2] or ".": hashlib.sha256(one.content or b"").hexdigest() for one in members}
    return Difference(field=field, note=_named(old, new) or "content differs in no file: links or permissions")


def between_trees(field: str, old: bytes, new: bytes) -> Difference:
    """Return how two tars differ, each of one file or folder."""
    files = [[one for one in plain_tar.members(blob) if one.content is not None] for blob in (old, new)]
    if all(len(one) == 1 and "/" not in one[0].path for one in files):
        before, after = ((one[0].content or b"").decode("utf-8", "replace") for one in files)
        return text_difference(field, Reply(status=0, out=before), after)
    hashes = [{one.path.partition("/")[2] or ".": hashlib.sha256(one.content or b"").hexdigest() for one in each}
              for each in files]  # fmt: skip
    return Difference(field=field, note=_named(*hashes) or "content differs in no file: links or permissions")


def _lines(reply: Reply) -> list[str]:
    return [line for line in lines_of(reply.out, _MOST_LINES) if len(line) > hashlib.sha256().digest_size * 2]


def _named(old: Mapping[str, str], new: Mapping[str, str]) -> str:
    """Return the names of files that differ, a few of each kind."""
    kinds = {
        "changed": sorted(name for name in old.keys() & new.keys() if old[name] != new[name]),
        "new": sorted(new.keys() - old.keys()),
        "gone": sorted(old.keys() - new.keys()),
    }
    return "; ".join(
        f"{len(names)} {kind}: {', '.join(names[:_MOST_NAMED])}{', …' if len(names) > _MOST_NAMED else ''}"
        for kind, names in kinds.items()
        if names
    )
