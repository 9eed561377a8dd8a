"""Files in which an image says what is installed in it -> packages.

Takes path -> content; gives packages, sorted. What has not the form of a name or a version is left out. Pure.

Source: deb822(5); apk-tools, "installed"; PyPA, "Core metadata specifications"; REP 149; os-release(5).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping

import msgspec

from srprov.untrusted import json_or_none, mapping, string

MOST = 100_000
"""Packages of an image."""
KINDS = ("deb", "apk", "pypi", "npm", "ros")
_NAME = re.compile(r"[A-Za-z0-9@_][A-Za-z0-9@/+._-]{0,127}")
_VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+:~!_-]{0,127}")
_ARCH = re.compile(r"[a-z0-9_-]{1,24}")
_WORD = re.compile(r"[A-Za-z0-9._-]{1,64}")
_XML_NAME = re.compile(r"<name>\s{0,80}([^<>\s]{1,128})\s{0,80}</name>")
_XML_VERSION = re.compile(r"<version(?:\s[^<>]{0,200})?>\s{0,80}([^<>\s]{1,128})\s{0,80}</version>")
_LONGEST_XML = 1 << 16
_LONGEST_LINE = 400
_EMPTY_LINE = re.compile(rb"^[ \t\r\f\v]*$", re.MULTILINE)


class Package(msgspec.Struct, frozen=True, order=True):
    """One package that is installed."""

    kind: str
    name: str
    version: str
    arch: str = ""
    by: str = ""
    """Of a Python package: what installed it, as far as it says so."""


class System(msgspec.Struct, frozen=True):
    """The distribution of an image."""

    id: str = ""
    version: str = ""


def system(files: Mapping[str, bytes]) -> System:
    """Return what an image calls itself."""
    text = next((files[one] for one in ("etc/os-release", "usr/lib/os-release") if one in files), b"")
    words: dict[str, str] = {}
    for line in text[:_LONGEST_XML].decode("utf-8", "replace").split("\n"):
        key, _, value = line.partition("=")
        try:
            words[key] = " ".join(shlex.split(value[:200]))
        except ValueError:
            continue
    id_, version = words.get("ID", ""), words.get("VERSION_ID", "")
    return System(id_ if _WORD.fullmatch(id_) else "", version if _WORD.fullmatch(version) else "")


def packages(files: Mapping[str, bytes]) -> tuple[Package, ...]:
    """Return all packages of an image.

    Raises:
        ValueError: There are too many.
    """
    found: set[Package] = set()
    for path, content in files.items():
        for one in _packages(path, content, files):
            if _NAME.fullmatch(one.name) and _VERSION.fullmatch(one.version):
                found.add(one)
        if len(found) > MOST:
            raise ValueError(f"it has more than {MOST} packages")
    return tuple(sorted(found))


def _packages(path: str, content: bytes, files: Mapping[str, bytes]) -> Iterator[Package]:
    folder, _, name = path.rpartition("/")
    if path == "var/lib/dpkg/status" or (folder == "var/lib/dpkg/status.d" and not name.endswith(".md5sums")):
        yield from _debian(content, listed=folder == "var/lib/dpkg")
    elif path.endswith("lib/apk/db/installed"):
        yield from _alpine(content)
    elif name in ("METADATA", "PKG-INFO") or name.endswith(".egg-info"):
        by = files.get(f"{folder}/INSTALLER", b"")[:80].decode("utf-8", "replace").strip()
        said = _fields(content, ("Name", "Version"))
        yield Package("pypi", said.get("Name", ""), said.get("Version", ""), by=by if _WORD.fullmatch(by) else "")
    elif name == "package.json":
        about = mapping(json_or_none(content[:_LONGEST_XML].decode("utf-8", "replace")))
        yield Package("npm", string(about.get("name")), string(about.get("version")))
    elif name == "package.xml":
        text = content[:_LONGEST_XML].decode("utf-8", "replace")
        found, version = _XML_NAME.search(text), _XML_VERSION.search(text)
        if found and version:
            yield Package("ros", found[1], version[1])


def _debian(content: bytes, *, listed: bool) -> Iterator[Package]:
    """Return what dpkg has installed; of an image without dpkg (`listed` is false) all that a file names."""
    for part in _parts(content):
        said = _fields(part, ("Package", "Version", "Architecture", "Status"))
        if said.get("Status", "" if listed else "installed").split()[-1:] == ["installed"]:
            arch = said.get("Architecture", "")
            good = arch if _ARCH.fullmatch(arch) else ""
            yield Package("deb", said.get("Package", ""), said.get("Version", ""), good)


def _alpine(content: bytes) -> Iterator[Package]:
    for part in _parts(content):
        name, version, arch = (_line(part, letter, 200, last=True) or "" for letter in ("P", "V", "A"))
        yield Package("apk", name, version, arch if _ARCH.fullmatch(arch) else "")


def _parts(content: bytes) -> Iterator[bytes]:
    """Return what empty lines separate. A file of megabytes may be nothing but such lines, or have none.

    Raises:
        ValueError: They are more than an image has packages.
    """
    at = count = 0
    while at < len(content):
        count += 1
        if count > MOST:
            raise ValueError(f"it has more than {MOST} packages")
        end = content.find(b"\n\n", at)
        end = len(content) if end < 0 else end
        yield content[at:end]
        at = end + 2


def _fields(content: bytes, names: tuple[str, ...]) -> dict[str, str]:
    """Return fields of the first part of a text of `Name: value` lines; of those of one name the first."""
    content = content.lstrip(b"\n")
    end = _EMPTY_LINE.search(content)
    part = content[: end.start()] if end else content
    said = {name: _line(part, name, _LONGEST_LINE) for name in names}
    return {name: value.strip() for name, value in said.items() if value is not None}


def _line(part: bytes, name: str, most: int, *, last: bool = False) -> str | None:
    """Return what stands behind `Name:`, on the first line that begins so or on the last one; None without one.

    Args:
        part: Of a file.
        name: How the line begins.
        most: Bytes of the line that count.
        last: Whether it is the last one.
    """
    begin = f"{name}:".encode()
    if part.startswith(begin) and not last:
        at = 0
    else:
        at = (part.rfind if last else part.find)(b"\n" + begin) + 1
        if not at and not part.startswith(begin):
            return None
    line = part[at : at + most]
    return line[len(begin) :].partition(b"\n")[0].decode("utf-8", "replace")


def as_named(one: Package) -> str:
    """Return a package as a CDF and a lock name it, such as `curl=7.88.1-10`."""
    return f"{one.name}{ {'deb': '=', 'pypi': '=='}.get(one.kind, '@') }{one.version}"
