"""`./folder:/in/container:ro` -> a mount in its long form, by Compose's rules. Pure.

One letter before a colon is a drive of Windows to Compose, so that `a:/b` names no volume `a`.
"""

from __future__ import annotations

import posixpath
from typing import Any

from srprov.importing.compose.values import Value, refuse
from srprov.importing.position import Path

_PROPAGATION = {"rprivate", "private", "rshared", "shared", "rslave", "slave"}
KNOWN_MODES = {"ro", "rw", "nocopy", "z", "Z", *_PROPAGATION}
"""What may stand after the second colon. Compose drops other words in silence."""


def clean(path: str) -> str:
    """Return a path without `.`, `..` and slashes that mean nothing."""
    tidy = posixpath.normpath(path) if path else ""
    return tidy[1:] if tidy.startswith("//") else tidy


def parse(value: Value, path: Path) -> dict[str, Any]:
    """Return the long form of a short one, as plain data.

    Raises:
        Refused: It is empty, or has a part that is, or has too many.
    """
    text: str = value.data
    if not text:
        raise refuse(value, "the mount is empty", path)
    if len(text) <= 2 and len(text.encode()) <= 2:
        return {"type": "volume", "target": text}
    parts = _parts(text)
    if not all(parts):
        raise refuse(value, f"a part of the mount '{text[:200]}' is empty", path)
    if len(parts) == 1:
        return {"type": "volume", "target": parts[0], "volume": {}}
    if len(parts) > 3:
        raise refuse(value, f"the mount '{text[:200]}' has too many colons", path)
    mount: dict[str, Any] = {"source": parts[0], "target": parts[1]}
    for option in parts[2].split(",") if len(parts) > 2 else ():
        _option(mount, option)
    if _is_file(parts[0]):
        mount["type"] = "bind"
        mount.setdefault("bind", {})["create_host_path"] = True
    else:
        mount["type"] = "volume"
        mount.setdefault("volume", {})
    return mount


def _option(mount: dict[str, Any], option: str) -> None:
    if option in ("ro", "rw"):
        mount["read_only"] = option == "ro"
    elif option == "nocopy":
        mount["volume"] = {"nocopy": True}
    elif option in _PROPAGATION:
        mount.setdefault("bind", {})["propagation"] = option
    elif option in ("z", "Z"):
        mount.setdefault("bind", {})["selinux"] = option


def _parts(text: str) -> list[str]:
    """Split at colons; not at one that stands after a single letter."""
    parts, begin = [], 0
    for index, char in enumerate(text):
        if char == ":" and not (index - begin == 1 and text[begin].isalpha()):
            parts.append(text[begin:index])
            begin = index + 1
    return [*parts, text[begin:]]


def _is_file(source: str) -> bool:
    return (
        source[0] in "./~"
        or source.startswith("\\\\")
        or (len(source) > 1 and source[1] == ":" and source[0].isalpha())
    )
