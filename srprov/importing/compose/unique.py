"""Entries of lists that stand for the same thing: of those, the last one counts, at the place of the first. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from srprov.importing.compose import volumes
from srprov.importing.compose.scalars import shown
from srprov.importing.compose.values import Rules, Value, refuse, rewrite
from srprov.importing.position import Path

Key = Callable[[Value, Path], str]


def by_name(entry: Value, path: Path) -> str:
    """Return what stands before `=`, or the whole text."""
    if not isinstance(entry.data, str):
        raise refuse(entry, "this must be text", path, "quote it" if not isinstance(entry.data, dict | list) else "")
    return entry.data.partition("=")[0]


def by_target(entry: Value, path: Path) -> str:
    """Return the path in the container that a mount is at."""
    if isinstance(entry.data, str):
        return str(volumes.parse(entry, path)["target"])
    target = entry.get("target")
    if target is None or not isinstance(target.data, str):
        raise refuse(entry, "the mount has no target", path)
    return target.data


def by_device(entry: Value, path: Path) -> str:
    """Return the path in the container that a device is at."""
    if isinstance(entry.data, str):
        parts = entry.data.split(":")
        return parts[0] if len(parts) == 1 else parts[1]
    target = entry.get("target")
    if target is None or not isinstance(target.data, str):
        raise refuse(entry, "the device has no target", path)
    return target.data


def by_port(entry: Value, path: Path) -> str:
    """Return all that a published port is told by."""
    if not isinstance(entry.data, dict):
        return shown(entry.data) if not isinstance(entry.data, list) else ""
    if entry.get("target") is None:
        raise refuse(entry, "the port has no target", path)
    fields = {"host_ip": "0.0.0.0", "published": "", "target": "", "protocol": "tcp"}  # noqa: S104 - no address to bind to
    for name in fields:
        if (value := entry.get(name)) is not None and not isinstance(value.data, dict | list):
            fields[name] = shown(value.data)
    return "{host_ip}:{published}:{target}/{protocol}".format(**fields)


def by_text(entry: Value, path: Path) -> str:
    """Return a port that is exposed."""
    if isinstance(entry.data, bool) or not isinstance(entry.data, str | int):
        raise refuse(entry, "this must be a port, or a range of ports", path)
    return str(entry.data)


def by_path(entry: Value, path: Path) -> str:
    """Return the path of a file of variables."""
    name = entry if isinstance(entry.data, str) else entry.get("path")
    if name is None or not isinstance(name.data, str) or not name.data:
        raise refuse(entry, "the file of variables has no path", path)
    return name.data


def mounted(folder: str) -> Key:
    """Return a key for what is mounted into a folder unless it says where."""

    def by_mount(entry: Value, path: Path) -> str:
        if isinstance(entry.data, str):
            return f"{folder}/{entry.data}"
        target, source = entry.get("target"), entry.get("source")
        if target is not None and isinstance(target.data, str):
            return target.data
        if not isinstance(entry.data, dict):
            raise refuse(entry, "this must be a name, or a map with a source", path)
        return f"{folder}/{source.data if source is not None else ''}"

    return by_mount


_NAMED = """networks.*.labels networks.*.ipam.options services.*.annotations services.*.build.args
    services.*.build.additional_contexts services.*.build.tags services.*.build.labels services.*.cap_add
    services.*.cap_drop services.*.deploy.labels services.*.dns services.*.dns_opt services.*.dns_search
    services.*.environment services.*.labels services.*.links services.*.networks.*.aliases
    services.*.networks.*.link_local_ips services.*.profiles services.*.sysctls services.*.tmpfs"""
_KEYS: Mapping[str, Key] = {
    **dict.fromkeys(_NAMED.split(), by_name),
    "services.*.configs": mounted(""),
    "services.*.devices": by_device,
    "services.*.env_file": by_path,
    "services.*.expose": by_text,
    "services.*.ports": by_port,
    "services.*.secrets": mounted("/run/secrets"),
    "services.*.volumes": by_target,
}
_RULES = Rules(_KEYS)


def unique(tree: Value) -> Value:
    """Return the tree without entries that a later one replaces.

    Raises:
        Refused: An entry does not say what it stands for.
    """
    return rewrite(tree, _RULES, _one)


def _one(key: Key, value: Value, path: Path) -> Value:
    if not isinstance(value.data, list):
        return value
    last: dict[str, Value] = {}
    for number, entry in enumerate(value.data):
        last[key(entry, (*path, number))] = entry
    return value.of(list(last.values()))
