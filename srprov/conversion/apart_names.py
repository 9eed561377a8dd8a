"""Names by which services of Compose files in folders apart reach each other: none may be another one's.

One overlay has the services of all files, of all robots. There a service of a stranger's file would be asked in the
place of the user's own, or of a host elsewhere, and told what that one is told, such as a password. What asks may lie
in any file that a service is given; so names count, not who is seen to use them. Takes projects; notes refusals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from srprov.conversion import names_used
from srprov.conversion.apart import hint, joined
from srprov.conversion.project import Project

_Services: TypeAlias = Mapping[str, Mapping[str, Any]]
Named: TypeAlias = "dict[str, dict[tuple[int, frozenset[str]], str]]"
"""Name in lower case -> the project's number, and files that say something of a service -> one such service."""


def refuse(projects: Sequence[Project]) -> None:
    """Note a refusal where a service may take the name of one of a file apart, or of a host that this one asks."""
    if not are_several(projects):
        return
    every, named = _every_file(projects), [_names(project) for project in projects]
    claimed = _claimed(projects, named)
    for number, project in enumerate(projects):
        for name, hosts in named[number].items():
            path, files = ("services", name), _files(project, name)
            if joined(project, path):
                continue
            for host in sorted(hosts):
                if "." in host and (file := _strange_file(projects, (number, files), every)):
                    words = f"'{host[:60]}', of '{name[:60]}', may be a host elsewhere for services of {file}"
                elif far := _other(projects, (number, files), claimed.get(host, {})):
                    words = f"'{host[:60]}', of '{name[:60]}', is a name that {far} has, or asks"
                else:
                    continue
                project.notes.refused(path, f"{words}, which is apart", hint(path))
                break


def _other(
    projects: Sequence[Project], own: tuple[int, frozenset[str]], others: Mapping[tuple[int, frozenset[str]], str],
) -> str:  # fmt: skip
    """Return in words which service of a file apart has a name, or asks it; empty if none does."""
    for (number, files), name in others.items():
        if (number, files) != own and _took(projects, own, (number, files)):  # of such files, it is refused as a whole
            return f"'{name[:60]}' of {min(files)}"
    return ""


def are_several(projects: Sequence[Project]) -> bool:
    """Return whether services come from files that are apart."""
    every = _every_file(projects)
    return any(_are_apart(projects, one, other) for one in every for other in every)


def _every_file(projects: Sequence[Project]) -> list[tuple[int, str]]:
    return [
        (number, file)
        for number, project in enumerate(projects)
        for file in sorted({file for name in _services(project) for file in _files(project, name)})
    ]


def _claimed(projects: Sequence[Project], named: Sequence[Mapping[str, set[str]]]) -> Named:
    """Return each name by which Compose, or the experiment, knows a service, and each that one has an address for.

    Joined services have none that counts: others of the same files still do.
    """
    found: Named = {}
    for number, project in enumerate(projects):
        for name, given in _services(project).items():
            if joined(project, ("services", name)):
                continue
            asked = {str(one).partition("=")[0].lower() for one in given.get("extra_hosts") or ()}
            for host in named[number][name] | asked:
                found.setdefault(host, {}).setdefault((number, _files(project, name)), name)
    return found


def _names(project: Project) -> dict[str, set[str]]:
    """Return service (as Compose has it) -> its names, in lower case."""
    services, found = _services(project), dict[str, set[str]]()
    links = names_used.links(services)
    for name, given in services.items():
        further = [one for one, _ in names_used.further(name, project, links.get(name, ()))]
        made = str(project.making.services[project.names[name]].get("hostname") or "")
        some = (name, project.names[name], str(given.get("hostname") or ""), made, *further)
        found[name] = {one.lower() for one in some if one}
    return found


def _took(projects: Sequence[Project], one: tuple[int, frozenset[str]], other: tuple[int, frozenset[str]]) -> bool:
    """Return whether files of two services are apart."""
    return any(_are_apart(projects, (one[0], a), (other[0], b)) for a in one[1] for b in other[1])


def _strange_file(
    projects: Sequence[Project], one: tuple[int, frozenset[str]], every: Iterable[tuple[int, str]]
) -> str:
    return next((far[1] for far in every if any(_are_apart(projects, (one[0], own), far) for own in one[1])), "")


def _are_apart(projects: Sequence[Project], one: tuple[int, str], other: tuple[int, str]) -> bool:
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
