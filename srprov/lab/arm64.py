"""A robot that says it is an arm64, on a machine that is none: what it takes beside the robot's own disk.

Programs of arm64 are run by Debian's qemu-user-static, which the kernel starts for them (binfmt_misc); what the robot
says of itself comes from small programs and a proxy before its engine. Debian's busybox for arm64 is the image's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from srprov.lab import cgroups, trust, trust_apt
from srprov.lab.machine import find, run
from srprov.lab.oci import architecture
from srprov.lab.places import CACHE, Site
from srprov.lab.spec import Robot

ARCH, MACHINE = "arm64", "aarch64"
"""In the words of container images, and of `uname -m`."""
EMULATOR = "qemu-aarch64-static"
PACKAGES = {EMULATOR: "qemu-user-static"}
INTERPRETER = Path("/usr/libexec/qemu-binfmt/aarch64-binfmt-P")
"""The same as Debian has binfmt_misc start it: its name says that programs keep the name they were called by (P)."""
PROGRAM = Path(__file__).with_name("engine_proxy.py")

MAGIC = r"\x7f\x45\x4c\x46\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00"
MASK = r"\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff"
ENTRY = "srprov-lab-aarch64"
LEFT = Path("/proc/sys/fs/binfmt_misc", ENTRY)
"""Where the entry stays after the last robot, on a machine that has binfmt_misc mounted itself."""

UNAME = """\
#!/bin/sh
# This robot says that it is an {machine}, to everybody who asks `uname` or `arch`.
out=$(/run/lab/${{0##*/}} "$@") || exit
printf '%s\\n' "$out" | sed 's/{own}/{machine}/g'
"""


def is_simulated(robot: Robot) -> bool:
    """Whether this robot has another architecture than the machine."""
    return robot.arch == ARCH != architecture()


def registration() -> str:
    """The entry for binfmt_misc. F: the kernel opens the emulator now, so that containers need none of their own."""
    program = INTERPRETER if INTERPRETER.exists() else find(EMULATOR)
    return f":{ENTRY}:M::{MAGIC}:{MASK}:{program}:OPF"


def forget() -> None:
    """Take back the entry, if the machine kept it."""
    if LEFT.exists():
        LEFT.write_text("-1")


def figures(folder: Path) -> None:
    """Write the files that boot.sh binds over `uname`, `arch` and the kernel's own word."""
    for program in ("uname", "arch"):
        (folder / program).write_text(UNAME.format(machine=MACHINE, own=os.uname().machine))
        (folder / program).chmod(0o755)
    (folder / "machine").write_text(f"{MACHINE}\n")


def start_proxy(site: Site, name: str, init: int) -> None:
    """Start the proxy before the engine of the robot with this PID 1; it waits for the engine."""
    proxy = [sys.executable, "-I", str(PROGRAM), str(init), MACHINE, f"linux/{ARCH}"]
    cgroups.start_beside(site, name, proxy, "engine_proxy.log")


def busybox() -> Path:
    """Debian's static busybox for arm64, fetched by apt once and kept."""
    ready = CACHE / f"busybox-{trust_apt.SUITE}-{ARCH}"
    if not ready.exists():
        folder = CACHE / "apt.new"
        shutil.rmtree(folder, ignore_errors=True)
        for part in ("state/lists/partial", "cache/archives/partial", "sources", "out"):
            (folder / part).mkdir(parents=True)
        sources = trust.files()
        (folder / "sources.list").write_bytes(sources["etc/apt/sources.list"])
        (folder / "sources/debian.sources").write_bytes(sources["etc/apt/sources.list.d/debian.sources"])
        (folder / "status").touch()
        run(_apt(folder, "update"))
        run(_apt(folder, "download", "busybox-static"))
        (package,) = folder.glob("*.deb")
        run(["dpkg", "-x", str(package), str(folder / "out")])
        (folder / "out/bin/busybox").rename(ready)
        shutil.rmtree(folder)
    return ready


def applets(program: Path) -> list[str]:
    """The names that a busybox for arm64 answers to."""
    listed = subprocess.run([find(EMULATOR) or EMULATOR, program, "--list"], capture_output=True, text=True, check=True)
    return listed.stdout.split()


def _apt(folder: Path, *words: str) -> Sequence[str]:
    """Apt-get for arm64, with the machine's sources and settings, and lists of its own."""
    settings = {
        "APT::Architecture": ARCH,
        "APT::Architectures": ARCH,
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
        "Dir::State": folder / "state",
        "Dir::State::status": folder / "status",
        "Dir::Cache": folder / "cache",
        "Dir::Etc::sourcelist": folder / "sources.list",
        "Dir::Etc::sourceparts": folder / "sources",
    }
    options = [word for key, value in settings.items() for word in ("-o", f"{key}={value}")]
    return ["env", "-C", str(folder), "apt-get", "-q", *options, *words]
