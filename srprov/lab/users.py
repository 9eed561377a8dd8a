"""A robot's own users: root without a password, and `robot`, who may use sudo and Docker.

Texts in, texts out, but for `write` and `authorize`, which put them on the robot's disk. The
machine's users are kept (its files belong to them) and their passwords are not.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

NAME = "robot"
HOME = "home/robot"
SUDOERS = f"{NAME} ALL=(ALL:ALL) NOPASSWD: ALL\n"


class Layer(Protocol):
    """Where a robot's files are written; paths are relative to its root."""

    def folder(self, path: str) -> Path:
        """A folder of the robot."""

    def write(self, path: str, text: str, mode: int = ..., owner: tuple[int, int] = ...) -> None:
        """A file of the robot."""


def add_group(text: str, name: str, members: Iterable[str] = ()) -> tuple[str, int]:
    """/etc/group with the group and the members in it; gives the text and the group's id."""
    lines = [line.split(":") for line in text.splitlines() if line.count(":") == 3]
    known = next((line for line in lines if line[0] == name), None)
    if known is None:
        known = [name, "x", str(free_id(int(line[2]) for line in lines)), ""]
        lines.append(known)
    present = [member for member in known[3].split(",") if member]
    known[3] = ",".join([*present, *(member for member in members if member not in present)])
    return "".join(":".join(line) + "\n" for line in lines), int(known[2])


def add_user(text: str, name: str, group: int, home: str) -> tuple[str, int]:
    """/etc/passwd with the user in it, in place of any so named; gives the text and the id."""
    lines = [line for line in text.splitlines() if line and not line.startswith(f"{name}:")]
    taken = (int(line.split(":")[2]) for line in lines if line.split(":")[2].isdigit())
    user = free_id(taken)
    lines.append(f"{name}:x:{user}:{group}:{name}:/{home}:/bin/bash")
    return "\n".join(lines) + "\n", user


def free_id(taken: Iterable[int]) -> int:
    """The first id from 1000 on that nobody has."""
    used = set(taken)
    return next(number for number in range(1000, 60000) if number not in used)


def shadow(passwd: str) -> str:
    """/etc/shadow where nobody has a password, or is locked (sshd refuses locked users)."""
    names = [line.split(":", 1)[0] for line in passwd.splitlines()]
    return "".join(f"{name}:*:19700:0:99999:7:::\n" for name in names)


def write(put: Callable[[str, str, int, tuple[int, int]], None]) -> None:
    """Write the robot's user files; `put` takes path, text, mode and owner."""
    group = Path("/etc/group").read_text()
    group, own = add_group(group, NAME)
    group, _ = add_group(group, "docker", [NAME])
    passwd, _ = add_user(Path("/etc/passwd").read_text(), NAME, own, HOME)
    put("etc/passwd", passwd, 0o644, (0, 0))
    put("etc/group", group, 0o644, (0, 0))
    put("etc/shadow", shadow(passwd), 0o600, (0, 0))
    put(
        "etc/gshadow",
        "".join(f"{line.split(':')[0]}:*::\n" for line in group.splitlines()),
        0o600,
        (0, 0),
    )
    put("etc/sudoers.d/srprov-lab", SUDOERS, 0o440, (0, 0))


def authorize(layer: Layer, public_key: str) -> None:
    """Let the lab's key in, for root and for `robot`."""
    passwd = layer.folder("etc") / "passwd"
    line = next(line for line in passwd.read_text().splitlines() if line.startswith(f"{NAME}:"))
    user, group = (int(word) for word in line.split(":")[2:4])
    for home, owner in (("root", (0, 0)), (HOME, (user, group))):
        keys = layer.folder(f"{home}/.ssh")
        keys.chmod(0o700)
        os.chown(keys, *owner)
        os.chown(keys.parent, *owner)
        layer.write(f"{home}/.ssh/authorized_keys", public_key, 0o600, owner)
