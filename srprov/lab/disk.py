"""A robot's disk: the upper layer of an overlay over the machine's root, made before it boots.

Writes below the lab's folder of disks only. What a robot must not see of the machine (homes,
logs, other folders of the root, the lab itself) is hidden by the overlay's own means: an opaque
folder hides what lies below it, a whiteout hides one name. What makes the robot a host of its own
(users, host key, host name) is written over the machine's.
"""

from __future__ import annotations

import os
import shutil
import stat
import time
import uuid
from pathlib import Path

from srprov import trees
from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import arm64, config, users
from srprov.lab.figures import loadavg, meminfo
from srprov.lab.machine import SYSTEM_PATH, require, run
from srprov.lab.places import NAMED, Site
from srprov.lab.spec import Robot

SHARED = {"bin", "boot", "etc", "lib", "lib32", "lib64", "libx32", "nix", "sbin", "usr", "var"}
STANDARD = {"dev", "home", "media", "mnt", "opt", "proc", "root", "run", "srv", "sys", "tmp"}
OWN = ("etc/docker", "etc/ssh", "var/lib/containerd", "var/lib/docker", "var/log", "var/tmp")
HIDDEN = ("var/cache/srprov-lab", "var/lib/docker-registry", "var/lib/srprov", "var/lib/srprov-lab", f"var/lib/{NAMED}")
LOOPS = Path("/sys/block")
DOCKER = ("containerd", "ctr", "docker", "docker-init", "docker-proxy", "dockerd", "runc")


def prepare(site: Site, robot: Robot) -> None:
    """Make the disk of a robot that has none, and bring what the options decide up to date."""
    top = site.disk(robot.name)
    if not (top / "made").exists():
        trees.remove(top)
        for part in ("upper", "work", "root", "docker", "figures"):
            (top / part).mkdir(parents=True)
        top.chmod(0o700)
        upper = Upper(top / "upper")
        _hide_machine(upper)
        _write_identity(upper, robot.name)
        (top / "made").touch()
    _write_options(site, Upper(top / "upper"), robot)
    _write_figures(top / "figures", robot)
    _make_docker_disk(top / "docker.img", robot.disk_mib or 0)


def remove(site: Site, name: str) -> None:
    """Remove the disk; the robot must be dead."""
    trees.remove(site.disk(name))


def host_key(site: Site, name: str) -> str:
    """The robot's public host key, as known_hosts wants it."""
    path = site.disk(name) / "upper/etc/ssh/ssh_host_ed25519_key.pub"
    return " ".join(path.read_text().split()[:2])


class Upper:
    """Writes the upper layer of an overlay over `/`; paths are relative to the root."""

    def __init__(self, top: Path) -> None:
        """`top` is the overlay's upperdir, not mounted now."""
        self.top = top

    def folder(self, path: str) -> Path:
        """The folder in this layer, with the rights that it has below: the upper one's count."""
        ours = self.top / path
        if not ours.exists():
            if path not in ("", "."):
                self.folder(os.path.dirname(path))
            ours.mkdir(exist_ok=True)
            below = Path("/", path)
            if below.is_dir():
                shutil.copystat(below, ours)
                os.chown(ours, below.stat().st_uid, below.stat().st_gid)
        return ours

    def empty(self, path: str) -> Path:
        """An empty folder that hides what lies below it."""
        ours = self.folder(path)
        os.setxattr(ours, "trusted.overlay.opaque", b"y")
        return ours

    def hide(self, path: str) -> None:
        """Make the name disappear (a whiteout), also when it only comes into being later."""
        ours = self.folder(os.path.dirname(path)) / os.path.basename(path)
        if not os.path.lexists(ours):
            os.mknod(ours, stat.S_IFCHR, os.makedev(0, 0))

    def unhide(self, path: str) -> None:
        """Take a whiteout away; anything else with that name stays."""
        ours = self.top / path
        if os.path.lexists(ours):
            found = ours.lstat()
            if stat.S_ISCHR(found.st_mode) and found.st_rdev == 0:
                ours.unlink()

    def write(self, path: str, text: str, mode: int = 0o644, owner: tuple[int, int] = (0, 0)) -> None:
        """Put a file into this layer; takes the place of whatever was there."""
        ours = self.folder(os.path.dirname(path)) / os.path.basename(path)
        draft = ours.with_name(f".{ours.name}.new")
        draft.write_text(text)
        draft.chmod(mode)
        os.chown(draft, *owner)
        draft.replace(ours)


def _hide_machine(upper: Upper) -> None:
    for entry in os.scandir("/"):
        if entry.name in SHARED or entry.is_symlink():
            continue
        if entry.name in STANDARD:
            upper.empty(entry.name)
        else:
            upper.hide(entry.name)
    for path in (*sorted(STANDARD), *OWN):
        upper.empty(path)
    for path in HIDDEN:
        upper.hide(path)
    (upper.top / "tmp").chmod(0o1777)
    (upper.top / "var/tmp").chmod(0o1777)
    (upper.top / "root").chmod(0o700)


def _write_identity(upper: Upper, name: str) -> None:
    """What the robot gets once, with its disk: users, host key, machine id."""
    users.write(upper.write)
    key = upper.folder("etc/ssh") / "ssh_host_ed25519_key"
    run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(key)])
    upper.write("etc/machine-id", uuid.uuid4().hex + "\n", 0o444)


def _write_options(site: Site, upper: Upper, robot: Robot) -> None:
    """What may differ at every boot."""
    upper.write("etc/hostname", robot.name + "\n")
    upper.write("etc/hosts", config.hosts(robot.name))
    upper.write("etc/resolv.conf", resolv_conf())
    upper.write("etc/docker/daemon.json", config.docker_daemon(site))
    upper.write("etc/ssh/sshd_config", config.sshd(site, robot))
    users.authorize(upper, site.key.with_suffix(".pub").read_text())
    users.set_rights(upper, robot.unprivileged, robot.sudo_password)
    users.set_noise(upper, robot.bashrc)
    folders = {os.path.realpath(folder) for folder in SYSTEM_PATH.split(":")}
    for program in DOCKER:
        for folder in sorted(folders):
            path = f"{folder}/{program}".lstrip("/")
            if robot.docker:
                upper.unhide(path)
            elif os.path.lexists(f"/{path}"):
                upper.hide(path)


def _write_figures(folder: Path, robot: Robot) -> None:
    """The files that boot.sh binds over /proc/loadavg, /proc/meminfo, `date` and others where wanted."""
    for path in folder.iterdir():
        path.unlink()
    if robot.load is not None:
        (folder / "loadavg").write_text(loadavg(robot.load))
    if robot.memory is not None or robot.swap is not None:
        text = meminfo(Path("/proc/meminfo").read_text(), robot.memory, robot.swap)
        (folder / "meminfo").write_text(text)
    if robot.clock_offset_s:
        (folder / "date").write_text(config.date(robot.clock_offset_s))
        (folder / "date").chmod(0o755)
    if robot.systemd:
        (folder / "systemctl").write_text(config.SYSTEMCTL)
        (folder / "systemctl").chmod(0o755)
    if arm64.is_simulated(robot):
        arm64.figures(folder)


def _make_docker_disk(image: Path, mib: int) -> None:
    """A small filesystem for Docker in a file; boot.sh mounts it. Another size starts with an empty one."""
    size = mib * 2**20
    if (image.stat().st_size if image.exists() else 0) == size:
        return
    image.unlink(missing_ok=True)
    if size:
        require({"mkfs.ext4": "e2fsprogs"})
        draft = image.with_suffix(".new")
        with open(draft, "wb") as file:
            file.truncate(size)
        run(["mkfs.ext4", "-q", "-F", "-m", "0", "-O", "^has_journal", str(draft)])
        draft.replace(image)


def await_release(site: Site, name: str, patience_s: float = 10.0) -> None:
    """Return when the kernel has let go of the dead robot's Docker disk: mounted twice, it would be corrupted."""
    image = str(site.disk(name) / "docker.img")
    until = time.monotonic() + patience_s
    while os.path.exists(image) and any(_backing(path).startswith(image) for path in LOOPS.glob("loop*/loop")):
        if time.monotonic() > until:
            raise LabError(f"{image} stays in use", hint="see `losetup -l`", code=Code.LAB_STUCK)
        time.sleep(0.01)


def _backing(loop: Path) -> str:
    try:
        return (loop / "backing_file").read_text()
    except OSError:  # let go while we look
        return ""


def resolv_conf() -> str:
    """The machine's name servers, but for those on its loopback: no robot can reach them."""
    for path in (Path("/etc/resolv.conf"), Path("/run/systemd/resolve/resolv.conf")):
        lines = path.read_text().splitlines() if path.exists() else []
        kept = [line for line in lines if not line.startswith(("nameserver 127.", "nameserver ::1"))]
        if any(line.startswith("nameserver") for line in kept):
            return "\n".join(kept) + "\n"
    return ""
