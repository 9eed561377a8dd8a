"""Files and folders of the experiment that are shipped to a robot, by content, read-only.

The name is `STATE_ROOT/<instance>/trees/<hash>`. The
path holds the content's hash and appears by one rename, so that being there means being right.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass

from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT, Module, Names
from srprov.resource import Action, Change, Observed, State
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_PARTS = 3


@dataclass(frozen=True, kw_only=True, slots=True)
class TreeParams:
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
        return (Query(command=f'for d in {STATE_ROOT}/*/trees/*; do [ -e "$d" ] && printf "%s\\n" "$d"; done; :'),)

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
        digest = hashlib.sha256(want.blob).hexdigest()[:24]
        return name == f"{STATE_ROOT}/{names.instance}/trees/{digest}" and _is_plain(want.blob)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it and what is empty above it."""
        return (remove_path(found.name),)


def _is_plain(blob: bytes) -> bool:
    """Return whether a tar is such as srprov ships: one file or folder, and nothing that could lie elsewhere.

    A mount of its top entry would follow a link there to any folder of the robot, and so would whatever lies below one.
    It must be byte for byte what is written here for its entries: no program that unpacks it finds others.
    """
    again = io.BytesIO()
    try:
        with (
            tarfile.open(fileobj=io.BytesIO(blob), mode="r:") as tar,
            tarfile.open(fileobj=again, mode="w", format=tarfile.PAX_FORMAT) as copy,
        ):
            members = tar.getmembers()
            for one in members:
                entry = tarfile.TarInfo(one.name)
                entry.type, entry.mode, entry.linkname, entry.size = one.type, one.mode, one.linkname, one.size
                copy.addfile(entry, tar.extractfile(one) if one.type == tarfile.REGTYPE and not one.sparse else None)
    except (tarfile.TarError, ValueError, OverflowError, OSError, EOFError):
        return False
    return again.getvalue() == blob and _stays_inside(members)


def _stays_inside(members: Sequence[tarfile.TarInfo]) -> bool:
    names, links = {one.name for one in members}, {one.name for one in members if one.issym()}
    for one in members:
        parts = one.name.split("/")
        above = {"/".join(parts[:depth]) for depth in range(1, len(parts))}
        fits = one.type in (tarfile.REGTYPE, tarfile.DIRTYPE) or (one.issym() and len(parts) > 1)
        if not fits or one.mode not in (0o644, 0o755) or {"", ".", ".."} & set(parts) or above & links:
            return False
    return len(names) == len(members) and len({name.split("/")[0] for name in names}) == 1
