"""Names by which services of Compose files in folders apart reach each other: none may be another one's.

One overlay has the services of all files, of all robots. There a service of a stranger's file would be asked in the
place of the user's own, or of a host elsewhere, and told what that one is told, such as a password. What asks may lie
in any file that a service is given; so names count, not who is seen to use them. A name is the word of the file that
says it, also of one that a service extends. Takes projects; notes refusals.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import msgspec

from srprov.conversion import names_used
from srprov.conversion.apart import hint, joined
from srprov.conversion.project import Project
from srprov.importing.position import Path

_Services: TypeAlias = Mapping[str, Mapping[str, Any]]
_File: TypeAlias = tuple[int, str]
"""The project's number, and what the file is called in positions."""
_OF_SERVICE = 3
"""Parts of the path of a service's value; of the service itself, whoever says anything of it says the name."""
_ENOUGH = 2
"""Services of the same files whose claims to a name are looked at: one of them is another one's."""


class _Name(msgspec.Struct, frozen=True):
    """A name that a service has, or that it has an address for."""

    host: str
    """In lower case."""
    number: int
    """The project's."""
    service: str
    """As Compose has it."""
    files: frozenset[str]
    """Which say the name."""
    own: bool
    """It has it."""


def refuse(projects: Sequence[Project]) -> None:
    """Note a refusal where a service may take the name of one of a file apart, or of a host that this one asks.

    A service that is joined may have its names; what others say of them still counts for these.
    """
    every = [one for number, project in enumerate(projects) for one in _names(number, project)]
    files = sorted({(one.number, file) for one in every for file in one.files} | {*_every_file(projects)})
    if not any(_are_apart(projects, one, other) for one in files for other in files):
        return
    claimed: dict[str, dict[tuple[int, frozenset[str]], list[_Name]]] = {}
    for one in every:
        same = claimed.setdefault(one.host, {}).setdefault((one.number, one.files), [])
        if len(same) < _ENOUGH and one.service not in {each.service for each in same}:
            same.append(one)
    done: set[tuple[int, str]] = set()
    for one in sorted(every, key=lambda one: (one.number, one.service, one.host)):
        path, project = ("services", one.service), projects[one.number]
        if not one.own or (one.number, one.service) in done or joined(project, path):
            continue
        if why := _why_not(projects, one, [each for same in claimed[one.host].values() for each in same], files):
            words = f"'{one.host[:60]}', of '{one.service[:60]}', {why}"
            project.notes.refused(path, f"{words}, which is apart", hint(project, path))
            done.add((one.number, one.service))


def _why_not(projects: Sequence[Project], one: _Name, others: Collection[_Name], files: Collection[_File]) -> str:
    """Return why a service may not have a name, or nothing."""
    if "." in one.host and (far := _apart_from(projects, one, files)):
        return f"may be a host elsewhere for services of {far[1]}"
    for other in others:
        itself = (other.number, other.service) == (one.number, one.service)
        far = None if itself else _apart_from(projects, one, [(other.number, file) for file in sorted(other.files)])
        if far:
            return f"is a name that '{other.service[:60]}' of {far[1]} has, or asks"
    return ""


def _apart_from(projects: Sequence[Project], one: _Name, files: Collection[_File]) -> _File | None:
    """Return the first of some files that is apart from one which says the name."""
    own = [(one.number, file) for file in sorted(one.files)]
    return next((far for far in files if any(_are_apart(projects, near, far) for near in own)), None)


def are_several(projects: Sequence[Project]) -> bool:
    """Return whether services come from files that are apart."""
    every = _every_file(projects)
    return any(_are_apart(projects, one, other) for one in every for other in every)


def _every_file(projects: Sequence[Project]) -> list[_File]:
    return [
        (number, file)
        for number, project in enumerate(projects)
        for file in sorted({file for name in _services(project) for file in _files(project, name)})
    ]


def _names(number: int, project: Project) -> Iterator[_Name]:
    """Yield each name by which Compose, or the experiment, knows a service, and each that one has an address for."""
    services, who = _services(project), _who_says(project)
    links = names_used.links(services)
    for name, given in services.items():
        at = ("services", name)
        some: list[tuple[str, Path]] = [(name, at), (project.names[name], at)]
        some += [(str(given.get("hostname") or ""), (*at, "hostname"))]
        some += names_used.further(name, project, links.get(name, ()))
        said: dict[str, frozenset[str]] = {}
        for one, path in some:
            if host := one.lower():
                said[host] = said.get(host, frozenset()) | who.get(path, _files(project, name))
        yield from (_Name(host, number, name, files, True) for host, files in said.items())
        asked = who.get((*at, "extra_hosts"), _files(project, name))
        for one in given.get("extra_hosts") or ():
            yield _Name(str(one).partition("=")[0].lower(), number, name, asked, False)


def _who_says(project: Project) -> dict[Path, frozenset[str]]:
    """Return path of a value in a service, or of a list -> the files that say it, or parts of it."""
    normal, found = project.notes.normal, dict[Path, set[str]]()
    for path, at in normal.positions.items():
        if path[:1] == ("services",) and at.file in (normal.homes or ()):
            for length in range(_OF_SERVICE, len(path) + 1):
                found.setdefault(path[:length], set()).add(at.file)
    return {path: frozenset(files) for path, files in found.items()}


def _are_apart(projects: Sequence[Project], one: _File, other: _File) -> bool:
    """Return whether two files, each with its project's number, are apart: of several robots, in other folders."""
    if one[0] == other[0]:
        return projects[one[0]].are_apart(one[1], other[1])
    homes = [(projects[number].notes.normal.homes or {}).get(file) for number, file in (one, other)]
    return homes[0] != homes[1]


def _services(project: Project) -> _Services:
    found: _Services = project.document.get("services") or {}
    return found


def _files(project: Project, service: str) -> frozenset[str]:
    return frozenset(one.at.file for one in project.notes.normal.parts.get(("services", service), ()))
