"""Paths in a file of another folder -> paths from the project's folder, where Compose has them so. Pure."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Mapping

from srprov.importing.compose.values import Rules, Value, rewrite
from srprov.importing.position import Path

_REMOTE = ("https://", "http://", "git://", "ssh://", "github.com/", "git@")


def joined(folder: str, path: str) -> str:
    """Return a path from the project's folder; absolute ones, and those from a home, stay."""
    if not path or path.startswith(("/", "~")):
        return path
    return posixpath.normpath(posixpath.join(folder, path))


def is_remote(context: str) -> bool:
    """Return whether a build context is no folder: an address, an image or a service."""
    return "://" in context or context.startswith(("service:", *_REMOTE))


Mover = Callable[[Value, str], Value]


def _path(value: Value, folder: str) -> Value:
    if isinstance(value.data, list):
        return value.of([_path(item, folder) for item in value.data])
    return value.of(joined(folder, value.data)) if isinstance(value.data, str) else value


def _context(value: Value, folder: str) -> Value:
    return value if not isinstance(value.data, str) or is_remote(value.data) else _path(value, folder)


def _mount(value: Value, folder: str) -> Value:
    kind, source = value.get("type"), value.get("source")
    if kind is None or kind.data != "bind" or source is None:
        return value
    windows = isinstance(source.data, str) and source.data[1:2] == ":"
    return value if windows else value.of({**value.data, "source": _path(source, folder)})


def _volume(value: Value, folder: str) -> Value:
    driver, options = value.get("driver"), value.get("driver_opts")
    if driver is None or driver.data != "local" or options is None:
        return value
    kind, device = options.get("o"), options.get("device")
    if kind is None or kind.data != "bind" or device is None:
        return value
    return value.of({**value.data, "driver_opts": options.of({**options.data, "device": _path(device, folder)})})


_MOVERS: Mapping[str, Mover] = {
    "services.*.build.context": _context,
    "services.*.build.additional_contexts.*": _context,
    "services.*.env_file.*.path": _path,
    "services.*.label_file": _path,
    "services.*.extends.file": _path,
    "services.*.develop.watch.*.path": _path,
    "services.*.volumes.*": _mount,
    "configs.*.file": _path,
    "secrets.*.file": _path,
    "volumes.*": _volume,
}
_RULES = Rules(_MOVERS)


def moved(tree: Value, folder: str) -> Value:
    """Return a tree in long forms whose relative paths begin at `folder`, seen from the project's own."""

    def one(mover: Mover, value: Value, path: Path) -> Value:
        return mover(value, folder)

    return rewrite(tree, _RULES, one)
