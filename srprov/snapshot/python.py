"""What pip installed on a robot, with the commits of what it took from git.

Takes records that pip left beside each package; gives packages. Pure. A record that says two things is noted.

Source: PEP 376 (INSTALLER), PEP 503, PEP 610 (direct_url.json), the core metadata specifications.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.sandbox import ELSEWHERE, NO_SANDBOX, NOT_CLOSED
from srprov.snapshot.notes import Notes
from srprov.untrusted import json_or_none, mapping, string, text

MOST = 900
_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,98}[A-Za-z0-9])?")
_VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9.!_-]{0,80}(?:\+[A-Za-z0-9][A-Za-z0-9._-]{0,80})?")
_COMMIT = re.compile(r"[0-9a-f]{40}|[0-9a-f]{64}")
_FOLDER = re.compile(r"(?P<name>[A-Za-z0-9._]+)-(?P<version>[A-Za-z0-9.!_+]+)\.dist-info")
_OWN = frozenset({"pip", "setuptools", "wheel"})
"""What an image has, or gets, of its own where it installs anything by pip."""

_NOT_READ = {
    str(NO_SANDBOX): f"are not read: {NOT_CLOSED}",
    str(ELSEWHERE): "are not read: a link is in the folder's path",
}


class PipPackage(msgspec.Struct, frozen=True, kw_only=True):
    """One package."""

    name: str
    version: str
    git: str = ""
    """Address of the repository that it came from."""
    commit: str = ""
    subfolder: str = ""


def normal(name: str) -> str:
    """Return the one form of a package's name."""
    return re.sub(r"[-_.]+", "-", name).lower()


def parse_installed(out: str, notes: Notes) -> tuple[PipPackage, ...]:
    """Read `dist FOLDER`, NUL, two lines of METADATA, NUL, direct_url.json, NUL, and so on.

    A folder of packages that could not be read comes with no METADATA and with a status of `sandbox.py`.
    """
    parts = out.split("\0")
    found: dict[str, PipPackage] = {}
    for at in range(0, len(parts) - 2, 3):
        if not parts[at].startswith("dist /"):
            break  # cut off in the middle
        folder = parts[at][5:]
        if not folder.endswith(".dist-info"):
            words = _NOT_READ.get(parts[at + 2], "cannot be read")
            notes.lost(f"pip packages in {text(folder, length=120)}", words)
            continue
        package = _package(folder, parts[at + 1], parts[at + 2], notes)
        if package is None:
            continue
        key = normal(package.name)
        if key in found:
            notes.lost(f"pip package {package.name}", f"is installed twice, also as version {package.version}")
        found.setdefault(key, package)
        if folder.startswith(("/home/", "/root/")):
            notes.adapted(
                f"pip package {package.name}", f"lies in a home ({folder[:80]}); in the image it is the system's"
            )
    if len(found) > MOST:
        notes.lost("pip packages", f"only {MOST} of {len(found)} are kept")
    return tuple(found[key] for key in sorted(found)[:MOST])


def _package(folder: str, metadata: str, direct: str, notes: Notes) -> PipPackage | None:
    fields = dict(line.partition(": ")[::2] for line in metadata.split("\n"))
    name, version = fields.get("Name", "").strip(), fields.get("Version", "").strip()
    base = posixpath.basename(folder)
    about = _FOLDER.fullmatch(base)
    if not _NAME.fullmatch(name) or not _VERSION.fullmatch(version) or about is None:
        notes.lost(f"pip package {base!r}", "has a name or version that no Python package has")
        return None
    if (normal(about["name"]), about["version"]) != (normal(name), version):
        notes.lost(f"pip package {base}", f"calls itself {name} {version} inside: one of the two is wrong")
        return None
    if not direct:
        return PipPackage(name=name, version=version)
    return _direct(name, version, mapping(json_or_none(direct)), notes)


def _direct(name: str, version: str, said: Mapping[str, Any], notes: Notes) -> PipPackage | None:
    """Return a package that came from an address."""
    vcs, url = mapping(said.get("vcs_info")), string(said.get("url"))
    commit, below = string(vcs.get("commit_id")), string(said.get("subdirectory"))
    subject = f"pip package {name}"
    if string(vcs.get("vcs")) == "git" and _COMMIT.fullmatch(commit):
        if below and (
            not re.fullmatch(r"[A-Za-z0-9._/-]{1,200}", below) or ".." in below.split("/") or below[0] == "/"
        ):
            notes.lost(subject, "is of a folder of its repository that is not written again")
            return None
        return PipPackage(name=name, version=version, git=url, commit=commit, subfolder=below)
    if mapping(said.get("dir_info")).get("editable") is True:
        notes.lost(subject, f"is an editable installation of a folder on the robot: {text(url, length=120)}")
    elif "vcs_info" in said:
        notes.lost(subject, "came from a version control system that is not git, or from no whole commit")
    else:
        notes.lost(subject, f"came from a folder or a file on the robot, or from an address: {_shown(url)}")
    return None


def _shown(url: str) -> str:
    return re.sub(r"//[^/]*@", "//", text(url, length=160))


def is_own(name: str) -> bool:
    """Return whether a package is a part of pip itself."""
    return normal(name) in _OWN
