"""What a service needs of a robot: `requires` -> Requirements, and those of a CDF and its service together. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from srprov.definitions.containermodel import Requirements
from srprov.definitions.values import flag, guarded, text, texts
from srprov.yamldoc import nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Path


def read(node: Node | None, findings: Findings, path: Path) -> Requirements:
    """Read one `requires`."""
    entries = node.entries if isinstance(node, Map) else {}
    get: Callable[[str], Any] = entries.get

    def size(key: str) -> int:
        given = get(key)
        return 0 if given is None else guarded(lambda n: size_in_bytes(text(n)), given, 0, findings, (*path, key))

    cpus = nodes.as_number(entries["cpus"]) if "cpus" in entries else 0.0
    version = text(get("kernel")).removeprefix(">=").strip()
    return Requirements(
        tags=tuple(dict.fromkeys(texts(get("tags")))),
        devices=tuple(dict.fromkeys(texts(get("devices")))),
        arch=tuple(_ARCH.get(name, name) for name in texts(get("arch"))),
        memory=size("memory"),
        cpus=cpus or 0.0,
        gpu=flag(get("gpu")),
        kernel=f">={version}" if version else "",
        disk=size("disk"),
    )


_ARCH = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "arm", "armv6l": "arm", "armhf": "arm"}


def combined(one: Requirements, other: Requirements) -> Requirements:
    """Return the requirements of which each robot must meet both.

    Raises:
        ValueError: They name architectures, and none in common.
    """
    arch = tuple(name for name in one.arch if name in other.arch) if one.arch and other.arch else one.arch or other.arch
    if (one.arch or other.arch) and not arch:
        raise ValueError(f"'{', '.join(other.arch)}' has nothing in common with the CDF's '{', '.join(one.arch)}'")
    return Requirements(
        tags=tuple(dict.fromkeys(one.tags + other.tags)),
        devices=tuple(dict.fromkeys(one.devices + other.devices)),
        arch=arch,
        memory=max(one.memory, other.memory),
        cpus=max(one.cpus, other.cpus),
        gpu=one.gpu or other.gpu,
        kernel=max(one.kernel, other.kernel, key=_version),
        disk=max(one.disk, other.disk),
    )


def _version(bound: str) -> tuple[int, ...]:
    return tuple(int(part) for part in bound.removeprefix(">=").split(".") if part)
