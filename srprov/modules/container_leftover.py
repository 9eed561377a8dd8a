"""What an engine forgets when it dies: containers of builds, and the process of one that it was starting. Pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from srprov.resource import Observed
from srprov.untrusted import string
from srprov.wire import Command, Run

BUILD = ".build"
"""The instance label of containers of a build, which `images/mark.py` sets; no instance has that name."""
BUILD_HOST = "srprov.build:127.0.0.1"
"""What containers of a build have in their hosts files, by how the engine is asked for it: no image says that."""
LISTING = "srprov..packages-"
"""How the name of a container begins that lists an image's packages; one runs only under the lock of its robot."""
FILLING = "srprov..fill-"
"""The same of one that is made to have its image fill volumes, and that never runs."""
_OF_ENGINE = re.compile(r"[a-z]{1,40}_[a-z]{1,40}[0-9]{0,2}|[0-9a-f]{12}")
"""What an engine calls a container that nobody gives a name: two words, or the beginning of its id."""
_IMAGE = re.compile(r"sha256:[0-9a-f]{64}")
"""A builder names the image of its last step by its id; whoever runs one, by its name."""
_OWN = re.compile(rf"({re.escape(LISTING)}|{re.escape(FILLING)})[0-9a-f]{{12}}")
_END_PROCESS = r"""for p in /proc/[0-9]*; do
    case $(tr '\0' ' ' <"$p/cmdline") in
        *containerd-shim*" -id ID"*) kill -9 "${p#/proc/}" ;;
        *) grep -q '[/-]ID' "$p/cgroup" && kill -9 "${p#/proc/}" ;;
    esac
done 2>/dev/null
:"""
"""The shim by its arguments, and the container's own processes by their control group."""
_ID = re.compile(r"[0-9a-f]{12,64}")


def left_by_build(item: Mapping[str, Any], state: Mapping[str, Any], builds: Collection[str]) -> Observed | None:
    """Return a container of a build that is over; one that runs may belong to a build that is under way.

    Its label alone says nothing: whoever publishes an image may give it that, and containers of others have it then,
    also of what they build on it. So it has to be one of `builds`, the ids of those that a build of srprov's made.
    One that lists packages counts also while it runs, and may do so for ever: who removes it has the robot's lock.
    """
    names = item.get("Names")
    name = string(names[0]).removeprefix("/") if isinstance(names, list) and names else ""
    own = _OWN.fullmatch(name)
    by_engine = _OF_ENGINE.fullmatch(name) and _IMAGE.fullmatch(string(item.get("Image")))
    of_build = by_engine and string(item.get("Id")) in builds
    if not (of_build and state["state"] != "running") and not own:
        return None
    verb = {LISTING: "a lock", FILLING: "an apply"}[own[1]] if own else "a build"
    why = {"leftover": f"left by {verb} that was cut off"}
    return Observed(module="container", name=name, instance="", state={**state, **why})


def end_process(unstarted: str) -> tuple[Command, ...]:
    """Return the script that ends what runs of a container that the engine takes for one that never ran, by its id.

    An engine that dies while it starts a container leaves a shim of containerd behind, which it does not know when it
    is back: it refuses to start that container ("already exists"), and removes it without its shim.
    """
    if not _ID.fullmatch(unstarted):
        return ()
    return (Run(script=_END_PROCESS.replace("ID", unstarted)),)
