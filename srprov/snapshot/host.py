"""One robot's answers -> what its image would need: base, packages, repositories, and what was noticed.

Takes the replies to `questions.QUESTIONS`; gives a `Host`, to which `with_origins` adds where packages come from. Pure.

Source: os-release(5).
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Collection, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.snapshot import debian, python, repositories, sources
from srprov.snapshot.debian import Chosen, Package, Policy
from srprov.snapshot.gitscript import Found
from srprov.snapshot.notes import Notes
from srprov.snapshot.python import PipPackage
from srprov.snapshot.questions import END, QUESTIONS
from srprov.snapshot.sources import Source
from srprov.untrusted import lines_of, text
from srprov.wire import Reply

_ARCHES = {"x86_64": "amd64", "aarch64": "arm64", "armv7l": "arm", "armv6l": "arm"}
_WORD = re.compile(r"[a-z0-9][a-z0-9._-]{0,40}")
_FAMILIAR = ("fedora", "alpine", "rockylinux", "almalinux", "archlinux")
_FILES_SHOWN = 100
_PACKAGES_SHOWN = 60
_NEEDED = ("setpriv", "prlimit", "git", "timeout", "base64")


class Host(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot said of itself."""

    base: str = ""
    """The image of its operating system; empty where there is none that is known."""
    arch: str = ""
    debian: bool = False
    root: bool = False
    """The shell is root's."""
    packages: tuple[Package, ...] = ()
    """All that are installed."""
    chosen: Chosen = msgspec.field(default_factory=Chosen)
    elsewhere: frozenset[str] = frozenset()
    """Packages that another archive than the distribution's has."""
    gone: frozenset[str] = frozenset()
    """Packages that no archive has."""
    older: frozenset[str] = frozenset()
    """Packages that archives have only in versions before the robot's."""
    sources: tuple[Source, ...] = ()
    keys: Mapping[str, bytes] = msgspec.field(default_factory=dict)
    """Absolute path -> public keys that archives are signed with."""
    pip: tuple[PipPackage, ...] = ()
    found: tuple[Found, ...] = ()
    """Repositories that are to be asked."""
    workspaces: tuple[tuple[str, str], ...] = ()
    """(folder, `colcon` or `catkin`)"""
    ros: tuple[str, ...] = ()


def read_host(replies: Sequence[Reply], notes: Notes) -> Host:
    """Read the replies to all of QUESTIONS."""
    said = {question.name: question.answer(reply) for question, reply in zip(QUESTIONS, replies, strict=True)}
    system = lines_of(said["system"], 400)
    base, is_debian = _base(system, notes)
    packages = debian.parse_packages(said["packages"], notes) if is_debian else ()
    if base and not packages:
        notes.lost("packages", "of a system without dpkg are not captured")
    ros = tuple(sorted(word for line in system if _WORD.fullmatch(word := _after(line, "ros "))))[:10]
    metadata = repositories.decoded(said["metadata"]).decode("utf-8", "replace")
    if not metadata.endswith(END):
        notes.lost("pip packages", "there are more than can be read, or reading them took too long")
    sourced = repositories.decoded(said["sources"]).decode("utf-8", "replace").removesuffix(END)
    _note_files(said["files"], notes)
    return Host(
        base=base,
        arch=_ARCHES.get(next((_after(line, "machine ") for line in system if line.startswith("machine ")), ""), ""),
        debian=is_debian,
        root="id 0" in system,
        packages=packages,
        chosen=debian.choose(packages, debian.parse_automatic(said["states"])),
        sources=sources.parse_sources(sourced, notes) if is_debian else (),
        pip=python.parse_installed(metadata.removesuffix(END), notes),
        found=_repositories(said["repositories"], system, notes),
        workspaces=_workspaces(said["workspaces"], notes),
        ros=ros,
    )


def _after(line: str, key: str) -> str:
    return line.removeprefix(key).strip() if line.startswith(key) else ""


def _base(system: Sequence[str], notes: Notes) -> tuple[str, bool]:
    """Return the image of an operating system, and whether it has Debian's packages."""
    about: dict[str, str] = {}
    for line in system:
        match = re.fullmatch(r"/(?:etc|usr/lib)/os-release:([A-Z_]{1,40})=(.{0,200})", line)
        if match:
            about.setdefault(match[1], match[2].strip().strip("\"'").lower())
    name, version, codename = (about.get(key, "") for key in ("ID", "VERSION_ID", "VERSION_CODENAME"))
    shown = text(about.get("PRETTY_NAME", name), length=80) or "unknown"
    if name == "debian" and _WORD.fullmatch(codename or "sid"):
        return f"debian:{codename or 'sid'}", True
    if name == "raspbian" and _WORD.fullmatch(codename):
        notes.adapted("base", f"{shown}: Debian's image of the same release takes its place")
        return f"debian:{codename}", True
    if name == "ubuntu" and _WORD.fullmatch(version):
        return f"ubuntu:{version}", True
    if name in _FAMILIAR and _WORD.fullmatch(version or "latest"):
        return f"{name}:{version or 'latest'}", False
    notes.lost("base", f"no image is known for this operating system: {shown}")
    return "", False


def _repositories(out: str, system: Sequence[str], notes: Notes) -> tuple[Found, ...]:
    found = repositories.parse_found(out, notes)
    missing = [name for name in _NEEDED if f"has {name}" not in system]
    if found and missing:
        notes.lost("repositories", f"{len(found)} are not read: the robot lacks {', '.join(missing)}")
        return ()
    return found


def _workspaces(out: str, notes: Notes) -> tuple[tuple[str, str], ...]:
    """Return workspaces of ROS; Python's own environments are noted."""
    found: dict[str, str] = {}
    for path in repositories.parts_of(out)[0][:400]:
        shown = text(path, length=200)
        if path.endswith("/pyvenv.cfg"):
            notes.lost(f"virtual environment {posixpath.dirname(shown)}", "is not captured")
        elif path.isprintable() and path.endswith("/install/setup.bash"):
            found[path.removesuffix("/install/setup.bash")] = "colcon"
        elif path.isprintable() and path.endswith("/devel/setup.bash"):
            found[path.removesuffix("/devel/setup.bash")] = "catkin"
    places = sorted(one for one in found.items() if one[0])
    return tuple(one for one in places if not any(one[0].startswith(f"{other}/") for other, _ in places))[:40]


def _note_files(out: str, notes: Notes) -> None:
    """Note the files that an administrator writes, by hash; what they hold is not captured."""
    for one in repositories.parts_of(out)[0][:_FILES_SHOWN]:
        digest, _, path = one.partition(" ")
        if re.fullmatch(r"[0-9a-f]{64}", digest):
            notes.lost(f"file {path}", f"of the host is not captured (sha256 {digest[:12]})")


def with_origins(host: Host, policy: Policy, origins: Mapping[str, str], notes: Notes) -> Host:
    """Return the host with what is known of where packages come from.

    Args:
        host: With all of its archives.
        policy: What apt knows of packages.
        origins: Address -> who signed it.
        notes: Takes what an image cannot get.
    """
    host = replace(host, sources=tuple(one for one in host.sources if not sources.is_distributions(one.url, origins)))
    wanted = [*host.chosen.by_hand, *host.chosen.others]
    if not any(policy.addresses.get(one.name) for one in wanted):
        if wanted:
            notes.adapted(
                "packages", "the robot has no lists of its archives: whether these still have each is not known"
            )
        return host
    gone = frozenset(one.name for one in wanted if not policy.addresses.get(one.name))
    older = frozenset(one.name for one in wanted if one.name in policy.ahead)
    _note_packages(gone, "is in none of the robot's archives: it came from a file, or is no longer there", notes)
    words = "is newer than any that the robot's archives have: the image gets an older one, with what that needs"
    _note_packages(older, words, notes)
    elsewhere = frozenset(
        one.name
        for one in wanted
        if (urls := policy.addresses.get(one.name)) and not any(sources.is_distributions(url, origins) for url in urls)
    )
    return replace(host, gone=gone, older=older, elsewhere=elsewhere)


def _note_packages(names: Collection[str], words: str, notes: Notes) -> None:
    """Note packages one by one, as long as these are not more than anybody reads."""
    for name in sorted(names)[:_PACKAGES_SHOWN]:
        notes.lost(f"package {name}", words)
    if len(names) > _PACKAGES_SHOWN:
        notes.lost("packages", f"{len(names) - _PACKAGES_SHOWN} more like the last one: --json lists them")
