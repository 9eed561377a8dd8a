"""`volumes` of a Compose service -> `volumes` of an EDF, with what is shipped and what a named volume begins with.

Takes a service's normal form; adds copies and seeds to the experiment. Looks at the file system. A relative source is a
path of the experiment when it is read-only or a file; a folder that may be written becomes a named volume that begins
with its content, for two services that mount it one and the same.
"""

from __future__ import annotations

import os
import re
from collections.abc import Container, Mapping
from typing import Any

from srprov import names
from srprov.conversion.project import Project
from srprov.importing.position import Path

_SYSTEM = re.compile(r"/(dev|proc|sys|run|var/run|etc|usr|lib|lib64|boot|tmp/\.X11-unix|tmp/\.docker\.xauth)(/.*)?\Z")
"""What Compose would make an empty folder of when it is missing, and nobody wants it to."""
_NO_NAME = re.compile(r"[^A-Za-z0-9_.-]+")
_HOME = re.compile(r"~(?P<user>[^/]*)(/(?P<below>.*))?\Z", re.DOTALL)
_NUMBERS = re.compile(r"[0-9]{1,10}(:[0-9]{1,10})?")
_OTHER = {"npipe": "only Windows has it", "cluster": "only a swarm has it", "image": "copy its files in a CDF"}


def volumes(given: Mapping[str, Any], service: str, project: Project, at: Path) -> list[object]:
    """Return the entries of a service's `volumes`."""
    found = []
    for index, one in enumerate(given.get("volumes") or ()):
        path = (*at, "volumes", index)
        kind = one.get("type")
        if kind in _OTHER:
            project.notes.refused((*path, "type"), f"a volume of the type '{kind}' cannot be had", _OTHER[kind])
        elif kind == "tmpfs":
            found.append(_tmpfs(one, project, path))
        elif kind == "volume":
            found.append(_named(given, one, service, project, path))
        else:
            found.append(_bind(given, one, project, path))
    return [one for one in found if one]


def _tmpfs(one: Mapping[str, Any], project: Project, path: Path) -> object:
    options = one.get("tmpfs") or {}
    size, mode = int(options.get("size") or 0), options.get("mode")
    kept = {**({"size": str(size)} if size else {}), **({"mode": f"{int(mode):04o}"} if mode else {})}
    return {
        "type": "tmpfs",
        "target": one["target"],
        **({"read_only": True} if one.get("read_only") else {}),
        **({"tmpfs": kept} if kept else {}),
    }


def _short(source: str, one: Mapping[str, Any]) -> object:
    """Return a mount in its short form, or in the long one where a colon would be read as the end of a path."""
    target, read_only = one["target"], bool(one.get("read_only"))
    if ":" in source or ":" in target:
        return {
            "type": "bind" if "/" in source else "volume",
            "source": source,
            "target": target,
            **({"read_only": True} if read_only else {}),
        }
    return f"{source}:{target}{':ro' * read_only}"


def _named(given: Mapping[str, Any], one: Mapping[str, Any], service: str, project: Project, path: Path) -> object:
    if (one.get("volume") or {}).get("subpath"):
        project.notes.refused((*path, "volume", "subpath"), "a volume is mounted as a whole")
    if one.get("read_only") and "nocopy" in (one.get("volume") or {}):  # so it is here
        project.notes.exact((*path, "volume", "nocopy"))
    name = one.get("source")
    if not name:
        made = _made_name(project.names[service], str(one["target"]), project)
        project.notes.adapted(path, f"without a name: the volume '{made}', which stays until destroy --volumes")
        return _short(made, one)
    device = _device(str(name), project)
    if device is None:
        return _short(_volume_name(str(name), project), one)
    if device.startswith("/"):
        return _short(device, one)
    at = ("volumes", str(name), "driver_opts", "device")
    return _bind(given, {**one, "source": device}, project, path, at) if device else None


def _made_name(service: str, target: str, project: Project) -> str:
    """Return the name of a volume that has none, which no other service can have, whatever it calls its own."""
    return _free(f"\0{service}\0{target}", _NO_NAME.sub("-", f"{service}{target}").strip("-."), project)


def _free(key: str, wanted: str, project: Project) -> str:
    """Return the name of a volume that is no other one's, also not one's of which the files say the name."""
    if key not in project.volume_names:
        _name(key, wanted, project, project.document.get("volumes") or {})
    return project.volume_names[key]


def _volume_name(name: str, project: Project) -> str:
    if name not in project.volume_names:
        clean = _NO_NAME.sub("-", name).lstrip("-._") or "volume"
        _name(name, clean, project)
    return project.volume_names[name]


def _name(key: str, wanted: str, project: Project, *taken: Container[str]) -> None:
    making = project.making
    made = making.free(wanted, project.machine.robot, making.volumes, making.mounted, *taken)
    project.volume_names[key] = made
    making.mounted.add(made)


def _device(name: str, project: Project) -> str | None:
    """Return the robot's path that a volume with `driver_opts` is; None: it is a plain one, "": it is refused."""
    entry = (project.document.get("volumes") or {}).get(name) or {}
    options, path = entry.get("driver_opts") or {}, ("volumes", name, "driver_opts")
    if not options:
        return None
    device = str(options.get("device", ""))
    if options.get("type") in (None, "none") and "bind" in str(options.get("o", "")).split(",") and device:
        whose = "the robot's own path" if device.startswith("/") else "mounted as a path of the files' folder is"
        project.notes.adapted(path, f"'{device[:80]}' is {whose}")
        return device
    project.notes.refused(path, "only binds of paths can be taken over", "mount it on the robots, and bind it")
    return ""


def _bind(
    given: Mapping[str, Any], one: Mapping[str, Any], project: Project, path: Path, named: Path = ()
) -> object:  # fmt: skip
    """Return a mount of a path; `named` is where that stands, if not in the mount itself."""
    source, at = str(one.get("source", "")), named or (*path, "source")
    if home := _HOME.match(source):
        return _at_home(one, home, project, path)
    if source.startswith("/"):
        return _absolute(source, one, project, path)
    if not project.place(source):
        why = f"'{source[:80]}' {project.outside(source, at)}"
        project.notes.refused(path, why, project.elsewhere(source))
        return None
    if one.get("read_only") or os.path.isfile(project.path(source)):
        return _shipped(source, one, project, path)
    return _seeded(source, given, one, project, path)


def _at_home(one: Mapping[str, Any], home: re.Match[str], project: Project, path: Path) -> object:
    user = home["user"] or project.making.choices.home
    below = (home["below"] or "").strip("/")
    if not names.valid("user", user) or ".." in below.split("/"):
        project.notes.refused(path, f"'{home[0][:80]}' is no path below the home of a robot's user")
        return None
    project.notes.adapted(
        path, f"'{home[0][:80]}' is in the home of the robot's user '{user}'", "" if home["user"] else "--home USER"
    )
    return _short(f"~{user}/{below}".rstrip("/"), one)


def _absolute(source: str, one: Mapping[str, Any], project: Project, path: Path) -> object:
    make = bool((one.get("bind") or {}).get("create_host_path"))
    if make and not _SYSTEM.match(source) and not source.endswith(".sock"):
        return {
            "type": "bind",
            "source": source,
            "target": one["target"],
            **({"read_only": True} if one.get("read_only") else {}),
            "bind": {"create_host_path": True},
        }
    if make:
        made = (*path, "bind", "create_host_path")
        project.notes.adapted(made, f"'{source}' must be there; Compose would make an empty folder")
    return _short(source, one)


def _shipped(source: str, one: Mapping[str, Any], project: Project, path: Path) -> object:
    if not os.path.exists(project.path(source)):
        hint = "Compose would mount an empty folder; make it, or leave it out"
        project.notes.refused(path, f"'{source[:80]}' does not exist", hint)
        return None
    if not one.get("read_only"):
        words = "a file is shipped to the robot read-only"
        project.notes.adapted(path, words, "for a service that writes to it, mount its folder, which becomes a volume")
    return _short(f"./{project.take(source)}", {**one, "read_only": False})


def _seeded(
    source: str, given: Mapping[str, Any], one: Mapping[str, Any], project: Project, path: Path
) -> object:  # fmt: skip
    place = project.place(source)
    name = _seed_name(place, project)
    if os.path.isdir(project.path(source)):
        project.take(source)
        user = str(given.get("user") or "")
        owner = {"user": user} if _NUMBERS.fullmatch(user) else {}
        project.making.volumes.setdefault(name, {"seed": f"./{place}", **owner})
        words = f"the volume '{name}', which begins with the folder's content; what is written stays on the robot"
        project.notes.adapted(
            path, words, "with ':ro' it is shipped read-only, and services that share it may be apart"
        )
    else:
        words = f"the volume '{name}', which begins empty: there is no such folder"
        project.notes.adapted(path, words)
    return _short(name, one)


def _seed_name(place: str, project: Project) -> str:
    """Return the name of the volume that begins with a folder's content; equal for equal folders."""
    stem = _NO_NAME.sub("-", place.partition("/")[2] or "project").strip("-._") or "folder"
    return _free(f"\0{place}", stem, project)
