"""What Compose does with a file that one would not guess: allowed, and worth a word. Looks at names of files."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence

from srprov.importing.compose.finish import services
from srprov.importing.compose.loading import File
from srprov.importing.compose.values import Value
from srprov.importing.compose.volumes import KNOWN_MODES
from srprov.importing.normal import Note
from srprov.importing.position import Position

_OWN_NAMES = ("compose.yaml", "compose.yml", "docker-compose.yml", "docker-compose.yaml")
"""Of files that Compose takes by itself."""


def of_command(files: Sequence[File], folder: str) -> Iterator[Note]:
    """Yield what `docker compose` would read beside a file that has the name of its own, and nobody named."""
    name = os.path.basename(files[0].path)
    if len(files) > 1 or name not in _OWN_NAMES:
        return
    for other in (one.replace(".y", ".override.y") for one in _OWN_NAMES):
        if os.path.lexists(os.path.join(folder, other)):
            message = (
                f"'{other}' lies beside it: `docker compose` without `-f` would lay it over this file; it is not read"
            )
            yield Note(Position(files[0].shown), message, f"name both files, {name} first")


def of_file(tree: Value) -> Iterator[Note]:
    """Yield what is odd in the short mounts of one file, as it is written."""
    for service in services(tree).values():
        mounts = service.get("volumes")
        for mount in mounts.data if mounts is not None and isinstance(mounts.data, list) else ():
            if isinstance(mount.data, str):
                yield from _mount(mount, mount.data)


def _mount(mount: Value, text: str) -> Iterator[Note]:
    if text[1:2] == ":" and text[0].isalpha() and text[2:3] != "\\":
        message = (
            f"'{text[:100]}': one letter before a colon is a drive of Windows to Compose, not the volume '{text[0]}'"
        )
        yield Note(mount.at, message, "give the volume a longer name")
    modes = text.rpartition(":")[2].split(",") if text.count(":") == 2 else []
    for mode in modes:
        if mode not in KNOWN_MODES and "/" not in mode:
            message = f"'{mode[:40]}' is no mode of a mount; Compose drops it, and the mount is writable"
            yield Note(mount.at, message, "write 'ro' for one that is only read")


def of_project(tree: Value, written: dict[Position, str]) -> Iterator[Note]:
    """Yield what is odd in environments; `written` is the text of each number by its place."""
    for name, service in services(tree).items():
        environment = service.get("environment")
        for variable, value in environment.data.items() if environment is not None else ():
            if value.data is None:
                message = (
                    f"service '{name}': {variable} has no value; Compose would take it from its caller's environment"
                )
                yield Note(value.place, message, f"give one: --set {shlex.quote(variable)}=VALUE")
            elif value.data != (text := written.get(value.at, value.data)):
                message = (
                    f"service '{name}': {variable} is '{value.data}' to Compose, since '{text[:60]}' is a number to it"
                )
                yield Note(value.at, message, f"quote it to have '{text[:60]}'")
