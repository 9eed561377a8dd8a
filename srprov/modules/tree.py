"""Files and folders of the experiment that are shipped to a robot, by content, read-only.

The name is `STATE_ROOT/<instance>/trees/<hash>`. The
path holds the content's hash and appears by one rename, so that being there means being right.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence

import msgspec

from srprov import plain_tar
from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT, Module, Names
from srprov.resource import Action, Change, Observed, State
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_PARTS = 3


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
        for line in replies[0].out.split("\n"):
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
        return Change(action=Action.CREATE, cause=f"not shipped yet ({len(want.blob)} bytes)", commands=commands)

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
