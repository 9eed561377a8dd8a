"""What a mount of a robot's own path gives away: just that path, or the engine and with it the robot. Pure."""

from __future__ import annotations

import posixpath

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
    are not known here: they need `host-path` in any case.
    """
    path = posixpath.normpath("/" + source.lstrip("/"))
    if path == "/var/run" or path.startswith("/var/run/"):
        path = path.removeprefix("/var")  # a link to it on every robot
    if path in _SOCKETS:
        return "docker-socket", ""
    if path == "/proc" or path.startswith("/proc/"):
        return "docker-socket", "leads to every file of the robot"
    if any(socket.startswith(f"{path.rstrip('/')}/") for socket in _SOCKETS):
        return "docker-socket", "holds the engine's socket"
    if any(f"{one}/".startswith(f"{path.rstrip('/')}/") or path.startswith(f"{one}/") for one in _ENGINES):
        return "docker-socket", "what an engine or srprov keeps"
    return "host-path", ""
