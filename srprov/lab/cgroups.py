"""One cgroup per robot: what it may use is counted there, and whatever runs in it is the robot's.

That second part makes `lab down` safe and complete after a killed run: the lab ends the processes
in its own cgroups and no others, whether or not it ever noted their ids. On cgroup v1 a robot
joins the group `srprov-lab/<robot>` of every hierarchy (`srprov-labs/<name>/<robot>` in a lab with
a name) and sees it as the root of its cgroup namespace; on v2 it is one delegated subtree
(written, never tested: docs/lab.md).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab.machine import SYSTEM_PATH
from srprov.lab.places import Site

ROOT = Path("/sys/fs/cgroup")
PERIOD_US = 100_000
"""A robot that has used its processor time waits for the next period; this is the kernel's own default."""


class Hierarchy(msgspec.Struct, frozen=True):
    """A mounted v1 hierarchy: its mount point and the options that mount it once more."""

    path: Path
    options: str

    @property
    def word(self) -> str:
        """As boot.sh reads it."""
        return f"{self.path.name}:{self.options}"


def version() -> int:
    """1 or 2, as Docker decides it: v2 only where it is mounted on /sys/fs/cgroup itself."""
    return 2 if (ROOT / "cgroup.controllers").exists() else 1


def hierarchies() -> list[Hierarchy]:
    """The v1 hierarchies of this machine (empty on v2)."""
    found: dict[Path, Hierarchy] = {}
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        fields, _, rest = line.partition(" - ")
        kind, _, options = rest.split(" ", 2)
        path = Path(fields.split(" ")[4])
        if kind == "cgroup" and path.parent == ROOT:
            found[path] = Hierarchy(path, _mount_options(options))
    return [found[path] for path in sorted(found)]


def _mount_options(super_options: str) -> str:
    """What to pass to mount(8): the controllers, or the name of a hierarchy without any."""
    wanted = [
        word
        for word in super_options.split(",")
        if word not in ("rw", "ro", "xattr", "clone_children", "none") and not word.startswith("release_agent=")
    ]
    named = any(word.startswith("name=") for word in wanted)
    return ",".join(["none", *wanted] if named and len(wanted) == 1 else wanted)


def _roots() -> list[Path]:
    return [ROOT] if version() == 2 else [hierarchy.path for hierarchy in hierarchies()]


def make(site: Site, robot: str = "") -> list[Path]:
    """Make the groups of a robot, or only those of the lab; return one folder per hierarchy."""
    roots = _roots()
    if not roots:
        raise LabError(
            f"no cgroups are mounted below {ROOT}", hint="mount them, Docker needs them too", code=Code.LAB_MACHINE
        )
    made = []
    for root in roots:
        group = root
        for part in (*site.group.parts, *filter(None, [robot])):
            if version() == 2:
                _delegate(group)
            group = group / part
            group.mkdir(exist_ok=True)
            _copy_cpuset(group)
        made.append(group)
    return made


def limit_cpus(groups: Sequence[Path], cpus: float) -> None:
    """Let the processes of a robot use so much processor time together, as by so many CPUs.

    Raises:
        LabError: This kernel has no such limit.
    """
    quota = round(cpus * PERIOD_US)
    for group in groups:
        if version() == 2 and (group / "cpu.max").exists():
            (group / "cpu.max").write_text(f"{quota} {PERIOD_US}")
            return
        if (group / "cpu.cfs_quota_us").exists():
            (group / "cpu.cfs_period_us").write_text(str(PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(str(quota))
            return
    raise LabError(
        "this kernel cannot limit a robot's CPUs",
        hint="it needs CONFIG_CFS_BANDWIDTH: leave `cpus` out",
        code=Code.LAB_MACHINE,
    )


def _copy_cpuset(group: Path) -> None:
    """Give a new v1 cpuset its parent's CPUs and memory: it has none, and nothing could join it."""
    for name in ("cpuset.cpus", "cpuset.mems"):
        ours = group / name
        if version() == 1 and ours.exists() and not ours.read_text().strip():
            ours.write_text((group.parent / name).read_text())


def _delegate(group: Path) -> None:
    """v2: let the children of `group` use every controller it has; one that refuses is left out."""
    for controller in (group / "cgroup.controllers").read_text().split():
        try:
            (group / "cgroup.subtree_control").write_text(f"+{controller}")
        except OSError:
            continue


LAUNCH = 'for group in $LAB_CGROUPS; do echo $$ >"$group/cgroup.procs"; done; exec "$0" "$@"'
"""For `sh -c`: joins the groups, then becomes the program."""


def set_aside(site: Site, robot: str, pid: int) -> None:
    """v2: move a process out of the robot's own group.

    The group hands controllers to its children only while nothing runs in itself.
    """
    if version() == 2:
        (beside(site, robot)[0] / "cgroup.procs").write_text(str(pid))


def beside(site: Site, robot: str) -> list[Path]:
    """The groups for processes that belong to the robot, but are not seen by it."""
    groups = [root / site.group / robot for root in _roots()]
    if version() == 2:
        groups = [group / "launcher" for group in groups]
        groups[0].mkdir(exist_ok=True)
    return groups


def start_beside(site: Site, robot: str, program: Sequence[str], log: str) -> None:
    """Start a program that belongs to the robot, is not seen by it and ends with it; `log` is a file of its disk."""
    with open(site.disk(robot) / log, "wb") as output:
        subprocess.Popen(
            ["/bin/sh", "-c", LAUNCH, *program],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            cwd="/",
            env={"PATH": SYSTEM_PATH, "LAB_CGROUPS": " ".join(map(str, beside(site, robot)))},
            start_new_session=True,
        )


def robots(site: Site) -> set[str]:
    """Robots that have a cgroup, alive or left behind by a killed run."""
    return {path.name for root in _roots() for path in (root / site.group).glob("*/")}


def processes(site: Site, robot: str) -> set[int]:
    """Every process of the robot and of its containers, as the machine numbers them."""
    found: set[int] = set()
    for root in _roots()[:1]:
        for listing in (root / site.group / robot).rglob("cgroup.procs"):
            try:
                found.update(int(word) for word in listing.read_text().split())
            except OSError:  # a container's group may go while we look
                continue
    return found - {0}


def memory(site: Site, robot: str) -> int | None:
    """Bytes that the robot's processes hold, without page cache; None when it cannot be told."""
    path, key = (ROOT, "anon") if version() == 2 else (ROOT / "memory", "total_rss")
    try:
        lines = (path / site.group / robot / "memory.stat").read_text().splitlines()
    except OSError:
        return None
    figures = dict(line.split(" ", 1) for line in lines)
    return int(figures[key]) if key in figures else None


def remove(site: Site, robot: str, patience_s: float = 5.0) -> None:
    """Remove the robot's groups; its processes have ended."""
    until = time.monotonic() + patience_s
    for root in _roots():
        _remove_tree(site, root / site.group / robot, until)


def remove_all(site: Site, patience_s: float = 5.0) -> None:
    """Remove the lab's groups, which nothing runs in; with the last lab that has a name, also what held them."""
    until = time.monotonic() + patience_s
    for root in _roots():
        _remove_tree(site, root / site.group, until)
        if site.name:
            with contextlib.suppress(OSError):  # another lab has a group there, or there was none
                (root / site.group).parent.rmdir()


def _remove_tree(site: Site, top: Path, until: float) -> None:
    for folder, _, _ in os.walk(top, topdown=False):
        while True:
            try:
                os.rmdir(folder)
            except FileNotFoundError:
                break
            except OSError as error:  # busy for a moment after the last process has gone
                if time.monotonic() > until:
                    hint = f"see who is in its cgroup.procs, then run `{site.command} down` again"
                    raise LabError(
                        f"cannot remove {folder}: {error.strerror}", hint=hint, code=Code.LAB_STUCK
                    ) from error
                time.sleep(0.01)
            else:
                break
