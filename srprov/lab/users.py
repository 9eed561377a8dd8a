"""A robot's own users: root without a password, and `robot`, who may use sudo and Docker.

Texts in, texts out, but for `write` and `authorize`, which put them on the robot's disk. The
machine's users are kept (its files belong to them) and their passwords are not.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import secrets
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab.config import NOISE_MARK, noise

NAME = "robot"
HOME = "home/robot"
SUDOERS = f"{NAME} ALL=(ALL:ALL) NOPASSWD: ALL\n"
SUDOERS_WITH_PASSWORD = f"{NAME} ALL=(ALL:ALL) ALL\n"
NO_SUDOERS = f"# {NAME} may become nobody else.\n"


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
    taken = (int(line.split(":")[2]) for line in lines if line.split(":")[2].isdecimal())
    user = free_id(taken)
    lines.append(f"{name}:x:{user}:{group}:{name}:/{home}:/bin/bash")
    return "\n".join(lines) + "\n", user


def drop_member(text: str, group: str, member: str) -> str:
    """/etc/group without the member in that group."""
    lines = [line.split(":") for line in text.splitlines()]
    for line in lines:
        if line[0] == group:
            line[3] = ",".join(each for each in line[3].split(",") if each != member)
    return "".join(":".join(line) + "\n" for line in lines)


def with_password(shadow_text: str, name: str, hashed: str) -> str:
    """/etc/shadow where the user has this hash (`*`: none)."""
    lines = [line.split(":") for line in shadow_text.splitlines()]
    return "".join(":".join([line[0], hashed, *line[2:]] if line[0] == name else line) + "\n" for line in lines)


def hash_of(password: str) -> str:
    """SHA-512 as in /etc/shadow, by the system's own crypt(3)."""
    library = ctypes.util.find_library("crypt")
    if library is None:
        raise LabError(
            "sudo_password needs libcrypt, which is missing here",
            hint="apt-get install libcrypt1",
            code=Code.LAB_MACHINE,
        )
    crypt = ctypes.PyDLL(library).crypt  # which no other thread runs meanwhile: crypt(3) has one place for all results
    crypt.restype = ctypes.c_char_p
    found = crypt(password.encode(), f"$6${secrets.token_hex(8)}".encode())
    if not found or not found.startswith(b"$6$"):
        raise LabError("the sudo_password cannot be hashed by crypt(3)", hint="give another one", code=Code.LAB_ORDER)
    return str(found.decode())


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


def authorize(layer: Layer, public_key: str) -> None:
    """Let the lab's key in, for root and for `robot`."""
    for home, owner in _homes(layer):
        keys = layer.folder(f"{home}/.ssh")
        keys.chmod(0o700)
        os.chown(keys, *owner)
        os.chown(keys.parent, *owner)
        layer.write(f"{home}/.ssh/authorized_keys", public_key, 0o600, owner)


def set_rights(layer: Layer, unprivileged: bool, sudo_password: str | None) -> None:
    """What `robot` may do: become root without a password, with one, or neither that nor use Docker."""
    etc = layer.folder("etc")
    group = (etc / "group").read_text()
    group = drop_member(group, "docker", NAME) if unprivileged else add_group(group, "docker", [NAME])[0]
    hashed = "*" if sudo_password is None else hash_of(sudo_password)
    rule = NO_SUDOERS if unprivileged else SUDOERS if sudo_password is None else SUDOERS_WITH_PASSWORD
    layer.write("etc/group", group)
    layer.write("etc/shadow", with_password((etc / "shadow").read_text(), NAME, hashed), 0o600)
    layer.write("etc/sudoers.d/srprov-lab", rule, 0o440)


def set_noise(layer: Layer, text: str | None) -> None:
    """Write what every shell of the users shall run first, or take it away again."""
    for home, owner in _homes(layer):
        for name in (".bashrc", ".profile"):
            ours = layer.folder(home) / name
            if text is not None:
                layer.write(f"{home}/{name}", noise(text), 0o644, owner)
            elif ours.is_file() and ours.read_text().startswith(NOISE_MARK):
                ours.unlink()


def _homes(layer: Layer) -> list[tuple[str, tuple[int, int]]]:
    """The homes of root and of `robot`, each with its owner."""
    passwd = (layer.folder("etc") / "passwd").read_text()
    line = next(line for line in passwd.splitlines() if line.startswith(f"{NAME}:"))
    user, group = (int(word) for word in line.split(":")[2:4])
    return [("root", (0, 0)), (HOME, (user, group))]
