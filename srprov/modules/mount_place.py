"""Where a robot's paths lead, as a plan saw it: what a container gets is what was shown. Pure.

A container that is there may put a link in the way of a path, at the latest when it is asked to end; the one that
mounts that path is made right after, and an engine follows links. So does root when it reads what the container left
there: where its paths led stays with it as a label.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from msgspec.structs import replace

from srprov.led import LED
from srprov.modules.module import canonical
from srprov.wire import Command, EngineCall, Run, quote

NOT_TOLD = ""
"""Where a path led, if its robot did not say so: no container is made with it."""

LEADS_TO = r"""# where a path leads; of one that is not there what is there of it counts, as the rest may be made
leads_to() {
  p=$1 r=
  while [ -n "$p" ] && [ ! -e "$p" ] && [ ! -L "$p" ]; do p=${p%/*}; done
  if [ -n "$p" ]; then r=$(readlink -f "$p") && [ -n "$r" ] || return 1; fi
  r=${r%/}${1#"$p"}
  printf '%s\n' "${r:-/}"
}
"""
AS_PLANNED = r"""as_planned() {
  r=$(leads_to "$1") && [ "$r" = "$2" ] && return 0
  echo "$1 leads to ${r:-what cannot be told}, and to ${2:-what was not told} when it was planned: plan again" >&2
  exit 1
}
"""


def guarded(command: Command, mounts: Iterable[Mapping[str, Any]], leads: Mapping[str, str]) -> Command:
    """Return a command of a container's step that fails where a path leads elsewhere than when it was planned.

    Args:
        command: Only a script looks: one comes before each container that has a path of the robot's. What makes the
            container gives it the label `LED`.
        mounts: The container's, in the engine's form.
        leads: The robot's path -> where it led when that was planned; of others nothing is known.
    """
    paths = sorted({str(one.get("Source")) for one in mounts if one.get("Type") == "bind"} & leads.keys())
    if paths and isinstance(command, EngineCall) and command.path == "/containers/create":
        body = json.loads(command.body)
        labels = {**body.get("Labels", {}), LED: canonical({one: leads[one] for one in paths})}
        return replace(command, body=canonical({**body, "Labels": labels}))
    if not paths or not isinstance(command, Run):
        return command
    looks = "".join(f"as_planned {quote(one)} {quote(leads[one])}\n" for one in paths)
    return replace(command, script=f"{LEADS_TO}{AS_PLANNED}{looks}{command.script}")
