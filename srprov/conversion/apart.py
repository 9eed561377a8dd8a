"""What Compose files in folders apart have together: refused, unless the user says that he means it.

Of several files one may be a stranger's. What has a name (a service, a volume, a config, a secret) is of the files that
say something of it. Two of them are apart where not each may name what lies in the other's folder; then one could put a
program of its own into a service of the user's, or have what that one is given. Takes a project; notes refusals.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from shlex import quote

from srprov.conversion.project import Project
from srprov.importing.compose.parts import KINDS, SETTINGS
from srprov.importing.normal import Note, Part
from srprov.importing.position import Path

_CALLED = {kind: kind[:-1] for kind in KINDS}
_NEXT = (
    "one may be a stranger's: look at what each says of it; where all is your own project: --root DIR; "
    "if you mean that they have it together: "
)


def refuse(projects: Sequence[Project]) -> None:
    """Note a refusal for each thing that files which are apart say something of, or get by what one of them says."""
    for project in projects:
        files = {one.at.file for some in project.notes.normal.parts.values() for one in some}
        if any(project.are_apart(one, other) for one in files for other in files):
            _things(project)
            _settings(project)
    _hosts(projects)


def _things(project: Project) -> None:
    normal = project.notes.normal
    for path, some in normal.parts.items():
        # of a service that is not there, one file may have taken away all
        there = path[0] == "services" or (len(path) == 2 and path[1] in (normal.document.get(str(path[0])) or ()))
        if there and not joined(project, path) and (both := _two_apart(project, some)):
            words = f"the {_CALLED[str(path[0])]} '{str(path[1])[:60]}' is of {' and '.join(map(_what, both))}"
            project.notes.refused(path, f"{words}, which are apart", _hint(path))


def _settings(project: Project) -> None:
    """An export's words on how services find each other hold for all: each gets variables of them."""
    normal, path = project.notes.normal, (SETTINGS,)
    services = [one for key, some in normal.parts.items() if key[0] == "services" for one in some]
    if not project.making.network or joined(project, path):
        return
    if both := _two_apart(project, [*services, *normal.parts.get(path, ())]):
        files = " and ".join(one.at.file for one in both)
        words = f"'{SETTINGS}' says how the services of all files find each other, of {files}, which are apart"
        project.notes.refused(path, words, _hint(path))


def _hosts(projects: Sequence[Project]) -> None:
    """Note a refusal where a service may take the name of a host elsewhere that another file's service asks.

    On the overlay all robots know it by that name. One with a dot may stand in any file that a service is given. One
    without counts where `extra_hosts` has it; but not of several robots' exports, where it is another robot's service.
    """
    asked = dict[str, list[tuple[Project, str]]]()  # host -> services whose `extra_hosts` have it
    for project in projects:
        for name, given in (project.document.get("services") or {}).items():
            for host in {str(one).partition("=")[0] for one in given.get("extra_hosts") or ()}:
                asked.setdefault(host.lower(), []).append((project, name))
    for project in projects:
        for name in project.document.get("services") or {}:
            entry, path = project.making.services[project.names[name]], ("services", name)
            for host in filter(None, (project.names[name], str(entry.get("hostname") or ""))):
                others = asked.get(host.lower(), ()) if not joined(project, path) else ()
                far = next((one for other, one in others if _took(host, (project, name), (other, one))), None)
                if far is not None:
                    words = f"'{host[:60]}', which the service '{far[:60]}' asks, is '{name[:60]}' of a file apart"
                    project.notes.refused(path, words, _hint(path))
                elif "." in host and not joined(project, path) and (file := _apart_from(project, path, projects)):
                    words = f"'{host[:60]}', of '{name[:60]}', may be a host elsewhere for services of {file}"
                    project.notes.refused(path, f"{words}, which is apart", _hint(path))


def _took(host: str, one: tuple[Project, str], other: tuple[Project, str]) -> bool:
    """Return whether two services are of files that are apart, each in its robot's project."""
    (project, name), (asking, far) = one, other
    if project is asking:
        parts = project.notes.normal.parts
        return _two_apart(project, (*parts.get(("services", name), ()), *parts.get(("services", far), ()))) is not None
    told = "." in host or (SETTINGS,) not in asking.notes.normal.parts
    return told and _homes(project, _files(project, name)) != _homes(asking, _files(asking, far))


def _apart_from(project: Project, path: Path, projects: Sequence[Project]) -> str:
    """Return a file with services that is apart from those that say something of one; empty if there is none."""
    own = _files(project, str(path[1]))
    for other in projects:
        every = {one.at.file for key, some in other.notes.normal.parts.items() if key[0] == "services" for one in some}
        for file in sorted(every):
            is_one = (
                any(project.are_apart(file, one) for one in own)
                if other is project
                else _homes(other, {file}) != _homes(project, own)
            )
            if is_one:
                return file
    return ""


def _files(project: Project, service: str) -> set[str]:
    return {one.at.file for one in project.notes.normal.parts.get(("services", service), ())}


def _homes(project: Project, files: Iterable[str]) -> set[str]:
    return {home for file in files for home in (project.notes.normal.homes or {}).get(file, ())}


def may_use(project: Project, path: Path, used: Path) -> bool:
    """Return whether the service that lists a thing by its name may have it; note the refusal if not.

    That is, of each file that says something of the thing, the file in which the service lists it may name what lies
    in that one's folder.
    """
    normal = project.notes.normal
    said = [one.at.file for one in normal.parts.get(path, ())] or [normal.position_of(path).file]
    own = normal.position_of(used).file
    strange = [one for one in said if not project.opens(one, own)]
    if not strange or joined(project, path):
        return True
    words = f"'{str(path[1])[:60]}' is a {_CALLED[str(path[0])]} of another file, {strange[0]}, of whose folder this"
    project.notes.refused(used, f"{words} one may name nothing", _hint(path))
    return False


def told(project: Project) -> Iterator[Note]:
    """Yield services that are made of several files which are apart: joined ones, and what they extend."""
    normal = project.notes.normal
    known, parts = normal.homes or {}, dict[Path, dict[str, None]]()
    for path, at in sorted(normal.positions.items(), key=lambda one: one[1]):
        if path[:1] == ("services",) and path[2:] and at.file in known:
            parts.setdefault(path[:2], {}).setdefault(at.file)
    for service, given in (project.document.get("services") or {}).items():
        for index, one in enumerate(given.get("volumes") or ()):
            if one.get("type") == "volume" and one.get("source"):
                path = ("services", service, "volumes", index, "source")
                parts.setdefault(("volumes", str(one["source"])), {}).setdefault(normal.position_of(path).file)
    for what, files in parts.items():
        if any(project.are_apart(one, other) for one in files for other in files):
            kind = _CALLED[str(what[0])]
            called, where = f"the {kind} '{str(what[1])[:60]}'", ", ".join(files)
            message = f"{called} has parts, or is mounted, in {where}, which are apart"
            hint = "where one of them is a stranger's, look at what it says of this one: it has what the others give it"
            yield Note(normal.position_of(what), message, hint)


def _two_apart(project: Project, some: Iterable[Part]) -> tuple[Part, Part] | None:
    """Return parts of two files of which one may not name what lies in the other's folder."""
    by_file = {one.at.file: one for one in reversed([*some])}
    pairs = ((one, other) for one in by_file.values() for other in by_file.values())
    return next((_in_order(one, other) for one, other in pairs if project.are_apart(one.at.file, other.at.file)), None)


def _in_order(one: Part, other: Part) -> tuple[Part, Part]:
    return (one, other) if one.at <= other.at else (other, one)


def _what(part: Part) -> str:
    keys = ", ".join(str(key)[:30] for key in part.keys)
    return f"{part.at.file}:{part.at.line}" + (f" ({keys[:200]})" if keys else "")


def joined(project: Project, path: Path) -> bool:
    """Return whether the user says that files have a thing together."""
    return key_of(path) in project.making.choices.joined


def _hint(path: Path) -> str:
    return f"{_NEXT}--join {quote(key_of(path))}"


def key_of(path: Path) -> str:
    """Return what a thing is called in reports, and by the user: `services.camera`."""
    return ".".join(str(part) for part in path)
