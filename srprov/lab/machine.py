"""The lab's hands on the machine: programs it runs, and what it needs to find there.

May start programs; decides nothing. A failing program becomes a `LabError` that carries what the
program said.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from srprov.codes import Code
from srprov.errors import LabError

SYSTEM_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"

PACKAGES = {
    "dockerd": "docker.io",
    "docker": "docker.io",
    "sshd": "openssh-server",
    "ssh-keygen": "openssh-client",
    "ip": "iproute2",
    "iptables": "iptables",
    "iptables-save": "iptables",
    "ebtables": "iptables",
    "ebtables-save": "iptables",
    "tc": "iproute2",
    "unshare": "util-linux",
    "nsenter": "util-linux",
    "docker-registry": "docker-registry",
}
"""Program -> Debian package, for every `lab up`."""

IMAGE_PACKAGES = {"debootstrap": "debootstrap", "busybox": "busybox"}
"""Needed only while the images are not cached."""

LAB_FOLDERS = ("usr", "etc", "var", "var/lib", "var/cache", "bin", "lib", "sbin")


def find(program: str) -> str | None:
    """The program's path, looking also where root's programs live."""
    return shutil.which(program, path=f"{os.environ.get('PATH', '')}:{SYSTEM_PATH}")


def run(command: Sequence[str], stdin: str | None = None) -> str:
    """Run a program to its end and give its output; LabError when it fails."""
    done = subprocess.run(
        [find(command[0]) or command[0], *command[1:]],
        input=stdin,
        stdin=subprocess.DEVNULL if stdin is None else None,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip() or "it said nothing").splitlines()
        why, how = "; ".join(said[-3:]), f"{done.returncode} of {' '.join(command)}"
        what = f"this machine refuses what the lab needs: {why} ({how})"
        raise LabError(what, hint="take the lab down, then bring it up again", code=Code.LAB_STUCK)
    return done.stdout


def succeeds(command: Sequence[str]) -> bool:
    """Whether the program exits with 0; its output is dropped."""
    program = [find(command[0]) or command[0], *command[1:]]
    return subprocess.run(program, capture_output=True, check=False).returncode == 0


def require_root() -> None:
    """The lab makes namespaces, mounts and links: it needs root."""
    if os.geteuid() != 0:
        raise LabError("the lab needs root", hint="run it again with sudo", code=Code.LAB_MACHINE)


def require(programs: Mapping[str, str]) -> None:
    """LabError that names every missing program at once, with the command that installs them."""
    missing = sorted(program for program in programs if find(program) is None)
    if missing:
        packages = " ".join(sorted({programs[program] for program in missing}))
        raise LabError(f"missing here: {', '.join(missing)}", hint=f"apt-get install {packages}", code=Code.LAB_MACHINE)


def require_plain_root() -> None:
    """LabError where system folders are mounts: an overlay of the root would show them empty."""
    apart = [f"/{folder}" for folder in LAB_FOLDERS if os.path.ismount(f"/{folder}")]
    if apart:
        what = f"{', '.join(apart)}: not on the root filesystem, where robots need it"
        raise LabError(what, hint="run the lab on a machine with one root filesystem", code=Code.LAB_MACHINE)


def write_setting(path: Path, value: str) -> None:
    """Have a kernel setting at that value; written directly, because `sysctl` may be a stub."""
    if path.read_text().strip() != value:
        path.write_text(value)
