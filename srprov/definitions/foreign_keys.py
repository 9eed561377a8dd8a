"""Keys that other tools have for what a service says otherwise here -> what to do about one. Pure."""

from __future__ import annotations

from collections.abc import Collection

_KEYS = {
    "build": ("cdf", "`cdf: Dockerfile` builds a Dockerfile, `cdf: NAME.cdf` what a CDF says"),
    "dockerfile": ("cdf", "`cdf: Dockerfile` builds a Dockerfile"),
    "deploy": (
        "replicas",
        "`replicas: 2` is how many run; `mem_limit` and `cpus` are limits; `robot`, `requires` say where",
    ),
    "scale": ("replicas", "`replicas: 2` is how many run"),
    "env": ("environment", "did you mean 'environment'?"),
    "cmd": ("command", "did you mean 'command'?"),
    "args": ("command", "did you mean 'command'?"),
    "hosts": ("robot", "`robot: NAME` is where it runs; `requires` lets srprov choose"),
    "host": ("robot", "`robot: NAME` is where it runs; `requires` lets srprov choose"),
    "node": ("robot", "`robot: NAME` is where it runs; `requires` lets srprov choose"),
    "placement": ("robot", "`robot: NAME` is where it runs; `requires` lets srprov choose"),
    "networks": ("network", "all services share the experiment's overlay; `network: host` is the robot's own"),
    "network_mode": ("network", "`network: host` is the robot's own, `network: none` is none"),
    "container_name": ("hostname", "srprov names containers; services find each other by their names, or `hostname`"),
    "links": ("depends_on", "services find each other by their names; `depends_on` says who starts first"),
    "configs": ("volumes", '`volumes: ["./FILE:/path"]` ships a file'),
    "mounts": ("volumes", "did you mean 'volumes'?"),
}
"""Key elsewhere -> the key here, and what to write."""


def hint(key: str, known: Collection[str]) -> str:
    """Return what to write for another tool's key, where the map has a key for it; else nothing."""
    ours, says = _KEYS.get(key, ("", ""))
    return says if ours in known else ""


def meant(key: str) -> str:
    """Return the key here that another tool's key stands for; empty if none."""
    return _KEYS.get(key, ("", ""))[0]
