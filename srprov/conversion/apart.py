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
    """Note a refusal for each thing that files which are apart say something of, or get by what one of them says.

    Names by which services are reached: see `apart_names`.
    """
    for project in projects:
        files = {one.at.file for some in project.notes.normal.parts.values() for one in some}
        if any(project.are_apart(one, other) for one in files for other in files):
            _things(project)
            _settings(project)


def _things(project: Project) -> None:
    normal = project.notes.normal
    for path, some in normal.parts.items():
        # of a service that is not there, one file may have taken away all
        there = path[0] == "services" or (len(path) == 2 and path[1] in (normal.document.get(str(path[0])) or ()))
        if there and not joined(project, path) and (both := two_apart(project, some)):
            words = f"the {_CALLED[str(path[0])]} '{str(path[1])[:60]}' is of {' and '.join(map(_what, both))}"
            project.notes.refused(path, f"{words}, which are apart", hint(project, path))


def _settings(project: Project) -> None:
    """An export's words on how services find each other hold for all: each gets variables of them."""
    normal, path = project.notes.normal, (SETTINGS,)
    services = [one for key, some in normal.parts.items() if key[0] == "services" for one in some]
    if not project.making.network or joined(project, path):
        return
    if both := two_apart(project, [*services, *normal.parts.get(path, ())]):
        files = " and ".join(one.at.file for one in both)
        words = f"'{SETTINGS}' says how the services of all files find each other, of {files}, which are apart"
        project.notes.refused(path, words, hint(project, path))


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
    project.notes.refused(used, f"{words} one may name nothing", hint(project, path))
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


def two_apart(project: Project, some: Iterable[Part]) -> tuple[Part, Part] | None:
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
    return key_of(project, path) in project.making.choices.joined


def hint(project: Project, path: Path) -> str:
    """Return what to do about a refusal of a thing."""
    return f"{_NEXT}--join {quote(key_of(project, path))}"


def is_key(text: str) -> bool:
    """Return whether a text may be what `key_of` calls a thing that files have together."""
    kind, _, name = text.rpartition(":")[2].partition(".")
    return text.rpartition(":")[2] == SETTINGS or (kind in KINDS and bool(name))


def key_of(project: Project, path: Path) -> str:
    """Return what a thing is called by the user: `services.camera`; with a map of robots, `robot1:services.camera`."""
    key = ".".join(str(part) for part in path)
    return f"{project.machine.robot}:{key}" if project.machine.robot else key
