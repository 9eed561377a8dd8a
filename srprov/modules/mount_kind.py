"""What a mount of a robot's own path gives away: just that path, or the engine and with it the robot. Pure.

An engine follows links. So a path is looked at on the robot, too, right before a container is made with it; and what
lies below a folder that a container writes to is whatever that container wants it to be.
"""

from __future__ import annotations

import posixpath
from bisect import bisect_left
from collections.abc import Callable, Iterable

from srprov.wire import quote

GRAVE = "docker-socket"
_SOCKETS = ("/run/docker.sock", "/run/containerd/containerd.sock", "/run/podman/podman.sock")
_ENGINES = (
    *("/run/docker", "/run/containerd", "/run/podman", "/run/containers", "/run/srprov", "/run/user"),
    *("/var/lib/docker", "/var/lib/containerd", "/var/lib/containers", "/var/lib/srprov"),
)
"""Folders in which engines, or srprov, keep sockets, images, volumes or secrets: /run/user of those without root."""


def mount_kind(source: str) -> tuple[str, str]:
    """Return the kind of a bind mount, and why it is graver than it looks.

    A folder that holds the engine's socket gives it away just so, as does whatever is, holds or lies below a folder of
    an engine's; /proc leads to every file of the robot by another name. Symbolic links of the robot but for /var/run
    are not known here: see `links_refused`.
    """
    path = plain(source)
    if path in _SOCKETS:
        return GRAVE, ""
    if path == "/proc" or path.startswith("/proc/"):
        return GRAVE, "leads to every file of the robot"
    if any(socket.startswith(f"{path.rstrip('/')}/") for socket in _SOCKETS):
        return GRAVE, "holds the engine's socket"
    if any(f"{one}/".startswith(f"{path.rstrip('/')}/") or path.startswith(f"{one}/") for one in _ENGINES):
        return GRAVE, "what an engine or srprov keeps"
    return "host-path", ""


def plain(source: str) -> str:
    """Return a path of a robot in one spelling."""
    path = posixpath.normpath("/" + source.lstrip("/"))
    # a link to it on every robot
    return path.removeprefix("/var") if path == "/var/run" or path.startswith("/var/run/") else path


def below(folders: Iterable[str]) -> Callable[[str], bool]:
    """Return what tells whether a path lies below one of some folders, and not whether it is one."""
    highest: list[str] = []
    for one in sorted(map(_key, folders)):
        if not (highest and one.startswith(highest[-1])):
            highest.append(one)

    def is_below(source: str) -> bool:
        path = _key(source)
        before = bisect_left(highest, path)  # of those that sort before it, only the last can hold it
        return before > 0 and path.startswith(highest[before - 1])

    return is_below


def _key(path: str) -> str:
    """Return a path so that a folder sorts right before what is below it, and is the beginning of that alone."""
    return plain(path).rstrip("/").replace("/", "\0") + "\0"


def links_refused(sources: Iterable[str]) -> str:
    """Return a script that fails where one of some paths leads to what is graver to mount than it looks; or nothing.

    Of a path that is not there, what is there of it counts: the rest may be made. One that is grave as it is written
    was asked for as that.
    """
    paths = sorted({one for one in sources if mount_kind(one)[0] != GRAVE})
    return "\n".join([_LOOK, *(f"leads_to_no_engine {quote(one)}" for one in paths)]) if paths else ""


def _grave_patterns() -> str:
    """Return what `mount_kind` calls grave, as the patterns of a shell's `case`."""
    exact, below = {"/", *_SOCKETS}, {"/proc", *_ENGINES}
    for one in (*_SOCKETS, *_ENGINES):
        parts = one.split("/")[1:-1]
        exact |= {"/" + "/".join(parts[:count]) for count in range(1, len(parts) + 1)}
    # where /var/run is no link, what leads there is spelled so
    every = [*sorted(exact | below), *(f"{one}/*" for one in sorted(below))]
    return "|".join([*every, *(f"/var{one}" for one in every if one.startswith("/run"))])


_LOOK = f"""\
leads_to_no_engine() {{
  p=$1 r=
  while [ -n "$p" ] && [ ! -e "$p" ] && [ ! -L "$p" ]; do p=${{p%/*}}; done
  if [ -n "$p" ]; then r=$(readlink -f "$p"); [ -n "$r" ] || {{ echo "cannot tell where $1 leads" >&2; exit 1; }}; fi
  r=${{r%/}}${{1#"$p"}}
  case ${{r:-/}} in {_grave_patterns()})
    echo "$1 leads to ${{r:-/}}: mount that, which asks for {GRAVE}" >&2; exit 1;;
  esac
}}"""
