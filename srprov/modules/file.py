"""Rendered files below the instance's folder on a robot.

Wanted parameters: `content` (text), `mode` (octal text), `in_place` (keep the inode: a file that is bind-mounted
into running containers must be rewritten, not replaced). The name is the absolute path.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from srprov.modules.module import STATE_ROOT
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_LIST = f"cd {STATE_ROOT} 2>/dev/null || exit 0; find . -mindepth 2 -maxdepth 2 -type f -exec sha256sum {{}} +"
_MIN_PARTS = 2


class FileModule:
    """The module of kind `file`."""

    kind = "file"

    def queries(self) -> tuple[AnyQuery, ...]:
        """Hash the files directly inside each instance's folder; shipped trees lie deeper and are not read."""
        return (Query(command=_LIST),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read `sha256  ./instance/name` lines."""
        found = []
        for line in replies[0].out.split("\n"):
            sha, _, path = line.partition("  ")
            parts = path.removeprefix("./").split("/")
            if len(sha) == hashlib.sha256().digest_size * 2 and len(parts) == _MIN_PARTS:
                name = f"{STATE_ROOT}/{'/'.join(parts)}"
                found.append(Observed(module="file", name=name, instance=parts[0], state={"sha256": sha}))
        return tuple(found)

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Compare contents by hash."""
        if found is None:
            return Change(action=Action.CREATE, cause="not there")
        if found["sha256"] == hashlib.sha256(want.params["content"].encode()).hexdigest():
            return None
        return Change(action=Action.UPDATE, cause="content differs", before=found)

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Write it whole."""
        in_place = bool(want.params.get("in_place")) and change.action is Action.UPDATE
        mode = int(want.params.get("mode", "0644"), 8)
        return (Put(path=want.name, content=want.params["content"].encode(), mode=mode, in_place=in_place),)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it, and the instance's folder when it was the last thing there."""
        return (remove_path(found.name),)


def remove_path(path: str, root: str = STATE_ROOT, *, with_root: bool = False) -> Run:
    """Return the script that removes a file or tree and then each folder above it, below `root`, that is empty.

    `with_root` tries the root itself, too.

    Raises:
        ValueError: The path is not inside an instance's folder; nothing else may ever be removed.
    """
    parts = path.removeprefix(root + "/").split("/")
    if not path.startswith(root + "/") or len(parts) < _MIN_PARTS or not all(p not in ("", ".", "..") for p in parts):
        raise ValueError(f"{path} is not inside an instance's folder")
    folders = [f"{root}/{'/'.join(parts[:n])}" for n in range(len(parts) - 1, 0, -1)] + [root] * with_root
    # rmdir refuses a folder that still holds something: that is the wanted end, not a failure
    tidy = "".join(f"; rmdir {quote(folder)} 2>/dev/null" for folder in folders)
    return Run(script=f"rm -rf {quote(path)} || exit 1{tidy}; test ! -e {quote(path)}")
