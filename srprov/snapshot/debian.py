"""The Debian packages of a robot: which were installed by hand, and which else an image needs to have the same ones.

Takes what dpkg-query prints, apt's file of what came by itself, and `apt-cache policy`; gives packages. Pure. What is
no name or version of a package is left out and noted.

Source: deb-control(5), deb-version(7), apt's extended_states, debootstrap's `minbase` (required packages and apt).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec

from srprov.snapshot.notes import Notes
from srprov.untrusted import lines_of
from srprov.wire import Query, sh

MOST = 6000
"""Packages of a robot."""
MOST_POLICY = 4 << 20
_NAME = re.compile(r"[a-z0-9][a-z0-9+.-]{0,98}[a-z0-9+]")
_VERSION = re.compile(r"[0-9A-Za-z][A-Za-z0-9.+:~-]{0,127}")
_ARCH = re.compile(r"[a-z0-9][a-z0-9-]{0,30}")
_DEPENDENCY = re.compile(r"([a-z0-9][a-z0-9+.-]*)(?::[a-z0-9-]+)?(?:\s*\([^()]{0,200}\))?")
_POLICY_NAME = re.compile(r"([a-z0-9][a-z0-9+.-]*)(?::[a-z0-9-]+)?:")
_POLICY_CHOICE = re.compile(r"  (Installed|Candidate): (\S{1,128})")
_POLICY_VERSION = re.compile(r"( \*\*\*|    ) (\S{1,128}) -?[0-9]{1,6}")
_POLICY_SOURCE = re.compile(r" {8,10}-?[0-9]{1,6} (\S{1,500})(?: .{0,300})?")
_STATUS = "/var/lib/dpkg/status"


class Package(msgspec.Struct, frozen=True, kw_only=True):
    """An installed package."""

    name: str
    version: str
    arch: str = ""
    essential: bool = False
    """In every image of the distribution."""
    required: bool = False
    """In every image of the distribution when it was new; the archive may think otherwise since."""
    depends: tuple[tuple[str, ...], ...] = ()
    """Each a list of alternatives."""


class Chosen(msgspec.Struct, frozen=True, kw_only=True):
    """What an image is told to install, sorted by name."""

    by_hand: tuple[Package, ...] = ()
    others: tuple[Package, ...] = ()
    """Would not come as dependencies: recommendations, what took the place of another one, and required packages."""


def parse_packages(out: str, notes: Notes) -> tuple[Package, ...]:
    """Read the list of packages; those that are only half there are left out."""
    found: dict[str, Package] = {}
    odd: list[str] = []
    lines = lines_of(out, 4 * MOST)
    for line in lines:
        columns = line.split("\t")
        if len(columns) != 8 or not columns[0].startswith(("ii", "hi")):
            continue
        _, name, arch, version, essential, priority, *needs = columns
        if not _NAME.fullmatch(name) or not _VERSION.fullmatch(version) or not _ARCH.fullmatch(arch):
            odd.append(name)
            continue
        package = Package(
            name=name,
            version=version,
            arch=arch,
            essential=essential == "yes",
            required=priority == "required",
            depends=tuple(_depends(", ".join(filter(None, needs)))),
        )
        if name in found and found[name].arch != arch:
            notes.lost(f"package {name}:{arch}", "is there for a second architecture")
        found.setdefault(name, package)
    for name in odd[:20]:
        notes.lost(f"package {name!r}", "has a name or version that no Debian package has")
    if len(found) > MOST or len(odd) > 20:
        notes.lost("packages", f"there are more than can be listed: {len(found)}, and {len(odd)} odd ones")
    return tuple(found[name] for name in sorted(found)[:MOST])


def _depends(text: str) -> Iterator[tuple[str, ...]]:
    for part in text.split(",", 400)[:400]:
        names = [match[1] for one in part.split("|", 50)[:50] if (match := _DEPENDENCY.fullmatch(one.strip()))]
        if names:
            yield tuple(names)


def parse_automatic(out: str) -> frozenset[str]:
    """Return the packages that apt installed by itself."""
    found, name = set(), ""
    for line in lines_of(out, 8 * MOST):
        key, _, value = line.partition(":")
        if key == "Package":
            name = value.strip()
        elif key == "Auto-Installed" and value.strip() == "1" and name:
            found.add(name)
    return frozenset(found)


def choose(packages: Sequence[Package], automatic: Collection[str]) -> Chosen:
    """Return what an image of the distribution lacks.

    A dependency brings the first of its alternatives, if that is on the robot; whatever else is there is asked for by
    name, and then satisfies what it did on the robot.
    """
    by_name = {one.name: one for one in packages}
    base = _closure({one.name for one in packages if one.essential} | ({"apt"} & by_name.keys()), by_name)
    usual = _closure(base | {one.name for one in packages if one.required}, by_name)
    by_hand = {name for name in by_name if name not in automatic and name not in usual}
    come = _closure(base | by_hand, by_name)
    rest = by_name.keys() - come
    return Chosen(
        by_hand=tuple(by_name[name] for name in sorted(by_hand)),
        others=tuple(by_name[name] for name in sorted(rest)),
    )


def _closure(start: Collection[str], by_name: Mapping[str, Package]) -> frozenset[str]:
    found, todo = set(start), list(start)
    while todo:
        for alternatives in by_name[todo.pop()].depends:
            first = alternatives[0]
            if first in by_name and first not in found:
                found.add(first)
                todo.append(first)
    return frozenset(found)


def policy_query(names: Iterable[str]) -> Query:
    """Ask apt where packages come from; it is told to write no cache."""
    no_cache = ("-o", "Dir::Cache::pkgcache=", "-o", "Dir::Cache::srcpkgcache=")
    words = sh("timeout", "30", "apt-cache", *no_cache, "policy", *names)
    return Query(command=f"{words} 2>/dev/null | head -c {MOST_POLICY}\n:", timeout_s=60)


class Policy(NamedTuple):
    """What apt knows of packages."""

    addresses: Mapping[str, tuple[str, ...]]
    """Package -> the addresses that have its installed version, or else any; none where only dpkg knows it."""
    ahead: frozenset[str] = frozenset()
    """Packages whose installed version is newer than any that an archive has."""


def parse_policy(out: str) -> Policy:
    """Read what apt said of packages."""
    versions: dict[str, dict[str, str]] = {}
    exact: dict[str, list[str]] = {}
    other: dict[str, list[str]] = {}
    name, installed = "", False
    for line in lines_of(out, 40 * MOST):
        if match := _POLICY_NAME.fullmatch(line):
            name, installed = match[1], False
            exact.setdefault(name, [])
            versions.setdefault(name, {})
            other.setdefault(name, [])
        elif name and (match := _POLICY_CHOICE.fullmatch(line)):
            versions[name][match[1]] = match[2]
        elif name and (match := _POLICY_VERSION.fullmatch(line)):
            installed = match[1] == " ***"
        elif name and (match := _POLICY_SOURCE.fullmatch(line)) and match[1] != _STATUS:
            (exact if installed else other)[name].append(match[1])
    newest = {name for name, of in versions.items() if of and of.get("Installed") == of.get("Candidate")}
    return Policy(
        addresses={name: tuple(dict.fromkeys(exact[name] or other[name])) for name in exact},
        ahead=frozenset(name for name in newest if other[name] and not exact[name]),
    )
