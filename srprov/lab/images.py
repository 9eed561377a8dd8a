"""The images that the lab's mirror serves, made once and cached.

`debian:bookworm` is debootstrap's minimal variant below a layer with what this machine trusts;
`busybox` is Debian's, with the libraries that it needs, and where a lab has robots of arm64 also Debian's
static one for those, under the same name. Two caches: debootstrap's tar file (half a minute of work)
and the registry's storage, named by a hash of all that goes into it. Each is made beside its
place and renamed into it, so a killed run leaves nothing half made in use.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence, Set
from pathlib import Path

from srprov.lab import arm64, machine, state, trust, trust_apt
from srprov.lab.oci import Image, Storage, architecture
from srprov.lab.places import CACHE
from srprov.lab.tarfiles import Layer

FORMAT = 3
"""Raise it when the same inputs shall give other images."""

Say = Callable[[str], None]
LEFT_OUT = (
    "./dev/*",
    "./etc/apt/sources.list",  # of debootstrap's mirror, perhaps with a password; the layer above has one
    "./etc/hostname",  # these two are this machine's, copied by debootstrap; a container gets its own
    "./etc/resolv.conf",
    "./proc/*",
    "./sys/*",
    "./var/cache/apt/*",
    "./var/lib/apt/lists/*",
    "./var/log/*",
)
USERS = {
    "etc/passwd": b"root:x:0:0:root:/root:/bin/sh\nnobody:x:65534:65534:nobody:/nonexistent:/bin/false\n",
    "etc/group": b"root:x:0:\nnogroup:x:65534:\n",
}


def ensure(used: Set[Path], say: Say, *, foreign: bool = False) -> Path:
    """Return the storage that the mirror's registry serves, made if it is not cached.

    Args:
        used: Storages that mirrors serve now; older ones beside them are removed.
        say: Is told what takes long.
        foreign: There are robots of arm64, on a machine that is none.
    """
    with state.locked(CACHE):  # two labs may come up at once
        return _ensure(used, say, foreign)


def _ensure(used: Set[Path], say: Say, foreign: bool) -> Path:
    busybox = machine.find("busybox")
    trusted, variables = trust.files(), trust.environment()
    plain = CACHE / f"registry-{_fingerprint(trusted, variables, busybox)}"
    both = plain.with_name(f"{plain.name}-{arm64.ARCH}")
    storage = both if foreign else plain
    if storage.exists():
        return storage
    machine.require(machine.IMAGE_PACKAGES)
    debian = _debian_tar(say)
    say("making the images debian:bookworm and busybox")
    if kept := trust.kept_here():
        say(f"without the names and passwords in {', '.join(kept)}: builds on robots have none for a proxy or mirror")
    draft = CACHE / "registry.new"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    base, top, box = (draft / f"{name}.tar" for name in ("base", "top", "busybox"))
    shutil.copyfile(debian, base)
    with Layer(top) as layer:
        layer.files(trusted)
        layer.file("usr/sbin/policy-rc.d", b"#!/bin/sh\nexit 101\n", 0o755)
    program = Path(busybox or "busybox")
    _write_busybox(box, program, machine.run([str(program), "--list"]).split())
    Storage(draft).add(Image("library/debian", trust_apt.SUITE, [base, top], ["bash"], variables))
    boxes = [Image("library/busybox", "latest", [box], ["sh"])]
    if foreign:
        say(f"fetching busybox for {arm64.ARCH}")
        other, program = draft / "other.tar", arm64.busybox()
        _write_busybox(other, program, arm64.applets(program))
        boxes.append(Image("library/busybox", "latest", [other], ["sh"], architecture=arm64.ARCH))
    Storage(draft).add(*boxes)
    for old in set(CACHE.glob("registry-*")) - used - {plain, both}:
        shutil.rmtree(old)
    draft.rename(storage)
    return storage


def _fingerprint(trusted: dict[str, bytes], variables: dict[str, str], busybox: str | None) -> str:
    digest = hashlib.sha256(f"{FORMAT} {architecture()} {sorted(variables.items())}".encode())
    for path in sorted(trusted):
        digest.update(f"\0{path}\0".encode() + trusted[path])
    if busybox is not None:
        digest.update(Path(busybox).read_bytes())
    return digest.hexdigest()[:16]


def _debian_tar(say: Say) -> Path:
    """Debootstrap's minimal Debian as a tar file."""
    mirror = trust.mirror()
    name = f"debian-{trust_apt.SUITE}-{architecture()}"
    ready = CACHE / f"{name}-{FORMAT}.tar"
    if ready.exists():
        return ready
    for old in CACHE.glob(f"{name}*.tar"):
        old.unlink()
    root = CACHE / "debootstrap.new"
    _remove_root(root)
    say(f"making debian:{trust_apt.SUITE} with debootstrap, once; this takes about half a minute")
    machine.run(["debootstrap", "--variant=minbase", trust_apt.SUITE, str(root), mirror])
    draft = ready.with_suffix(".new")
    sorted_by_name = ["--sort=name", "--numeric-owner", *(f"--exclude={path}" for path in LEFT_OUT)]
    machine.run(["tar", "--create", f"--file={draft}", f"--directory={root}", *sorted_by_name, "."])
    draft.rename(ready)
    _remove_root(root)
    return ready


def _remove_root(root: Path) -> None:
    """Remove debootstrap's folder; a killed run leaves its /proc and /sys mounted in there."""
    for mount in ("proc", "sys", "dev/pts", "dev"):
        if os.path.ismount(root / mount):
            machine.run(["umount", "--lazy", str(root / mount)])
    if root.exists():
        shutil.rmtree(root)


def _libraries(program: Path) -> list[Path]:
    """Give what a program is linked to. A static one has nothing, but Debian's static busybox cannot look up names."""
    listed = subprocess.run(["ldd", program], capture_output=True, text=True, check=False).stdout
    return sorted({Path(word) for word in listed.split() if word.startswith("/")})


def _write_busybox(path: Path, program: Path, applets: Sequence[str]) -> None:
    """Busybox with all its applets, and the few files that a shell expects."""
    with Layer(path) as layer:
        for folder in ("bin", "etc", "root"):
            layer.folder(folder)
        layer.folder("tmp", 0o1777)
        layer.folder("var")
        layer.folder("var/tmp", 0o1777)
        layer.file("bin/busybox", program.read_bytes(), 0o755)
        for library in _libraries(program):
            folder = library.parent.as_posix().lstrip("/")
            for depth in range(1, folder.count("/") + 2):
                layer.folder("/".join(folder.split("/")[:depth]))
            layer.file(library.as_posix().lstrip("/"), library.read_bytes(), 0o755)
        for applet in sorted(set(applets) - {"busybox"}):
            layer.link(f"bin/{applet}", "busybox")
        layer.files(USERS)
