"""Files and folders of the experiment that are shipped to a robot, by content, read-only.

The name is `STATE_ROOT/<instance>/trees/<hash>`; `blob` is a tar whose single top entry is the file or folder. The
path holds the content's hash and appears by one rename, so that being there means being right.
"""

from __future__ import annotations

from collections.abc import Sequence

from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_PARTS = 3


class TreeModule:
    """The module of kind `tree`."""

    kind = "tree"

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

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Ask only whether it is there."""
        size = len(want.params["blob"])
        return Change(action=Action.CREATE, cause=f"not shipped yet ({size} bytes)") if found is None else None

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Send the tar, unpack beside the final place, rename."""
        tar, part, final = f"{want.name}.tar", f"{want.name}.part", want.name
        unpack = (
            f"rm -rf {quote(part)} && mkdir -p {quote(part)} && tar -xf {quote(tar)} -C {quote(part)} && "
            f"rm -f {quote(tar)} && chmod 0755 {quote(part)} && mv {quote(part)} {quote(final)}"
        )
        return (
            Put(path=tar, content=want.params["blob"], mode=0o600, timeout_s=600),
            Run(script=unpack, timeout_s=600),
        )

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it and what is empty above it."""
        return (remove_path(found.name),)
