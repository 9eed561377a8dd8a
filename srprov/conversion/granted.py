"""`secrets` and `configs` of a Compose service -> `secrets` of the EDF, and files that are shipped.

A secret's value is never read and never copied: the EDF says where it is. Looks at the file system.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping
from typing import Any

from srprov.conversion.project import WRITTEN, Project
from srprov.definitions.model import makes_repository
from srprov.importing.position import Path

_NAME = re.compile(r"[^A-Za-z0-9_.-]+")
_MODE = "0444"
"""Of secrets and configs in Compose."""


def secrets(given: Mapping[str, Any], project: Project, at: Path, folder: str) -> list[object]:
    """Return a service's `secrets`; `folder` is where the experiment will lie."""
    found: list[object] = []
    for index, one in enumerate(given.get("secrets") or ()):
        name = str(one.get("source"))
        entry = (project.document.get("secrets") or {}).get(name) or {}
        source = _source(entry, ("secrets", name), project, folder)
        if source is None:
            continue
        target = str(one.get("target") or name)
        found.append(_use(_secret(name, source, project), target, f"/run/secrets/{name}", one))
        project.notes.exact((*at, "secrets", index, "source"))
    return found


def _use(name: str, target: str, usual: str, one: Mapping[str, Any]) -> dict[str, str]:
    where = {} if target in (usual, usual.rpartition("/")[2]) and usual.endswith(f"/{name}") else {"target": target}
    return {"source": name, **where, "mode": str(one.get("mode") or _MODE)}


def _source(entry: Mapping[str, Any], path: Path, project: Project, folder: str) -> dict[str, str] | None:
    """Return where the value is, as an EDF says it; None when that cannot be said."""
    if entry.get("environment"):
        return {"env": str(entry["environment"])}
    if entry.get("file"):
        real = os.path.realpath(project.path(os.path.expanduser(str(entry["file"]))))
        project.making.withheld.add(real)
        return {"file": os.path.relpath(real, folder)}
    project.notes.refused(
        path, f"the value of '{str(path[1])[:60]}' is not here", "give it a 'file' or an 'environment'"
    )
    return None


def _secret(name: str, source: Mapping[str, str], project: Project) -> str:
    """Return the name of a secret in the experiment; two projects with the same one share it."""
    known = project.making.secrets
    clean = _NAME.sub("-", name).strip("-.") or "secret"
    key = (clean, frozenset(source.items()))
    if key not in project.making.secret_names:
        made = project.making.secret_names[key] = project.making.free(clean, project.machine.robot, known)
        known[made] = dict(source)
    return project.making.secret_names[key]


def configs(given: Mapping[str, Any], project: Project, at: Path, folder: str) -> tuple[list[object], list[object]]:
    """Return what a service's `configs` add to its `volumes`, and to its `secrets`."""
    mounts: list[object] = []
    uses: list[object] = []
    for index, one in enumerate(given.get("configs") or ()):
        name = str(one.get("source"))
        entry = (project.document.get("configs") or {}).get(name) or {}
        path, target = ("configs", name), str(one.get("target") or f"/{name}")
        target = target if target.startswith("/") else f"/{target}"
        if entry.get("environment"):
            source = {"env": str(entry["environment"])}
            uses.append(_use(_secret(name, source, project), target, "", one))
        elif place := _shipped(entry, name, path, project):
            mounts.append(f"./{place}:{target}")
        project.notes.exact((*at, "configs", index, "source"))
    return mounts, uses


def _file_name(config: str) -> str:
    """Return what the file is called in which a config is written: nothing that leads elsewhere, or is git's own."""
    clean = _NAME.sub("-", config)
    return f"config-{clean}" if not clean.strip(".") or makes_repository(clean, folder=False) else clean


def _shipped(entry: Mapping[str, Any], name: str, path: Path, project: Project) -> str:
    """Have a config's file copied or written, and return its path in the experiment."""
    if entry.get("content") is not None:
        first, content, texts = f"{WRITTEN}/configs/{_file_name(name)}", str(entry["content"]), project.making.texts
        every = itertools.chain([first], (f"{first}-{number}" for number in itertools.count(2)))
        place = next(one for one in every if texts.get(one, content) == content)
        texts[place] = content
        return place
    source = str(entry.get("file") or "")
    if not source:
        project.notes.refused(path, f"the content of '{name[:60]}' is not here", "give it a 'file' or a 'content'")
        return ""
    place = project.place(source)
    if not place or not os.path.exists(project.path(source)):
        what, hint = project.outside(source, (*path, "file")), project.elsewhere(source)
        if place:
            what, hint = "does not exist", ""
        project.notes.refused((*path, "file"), f"'{source[:80]}' {what}", hint)
        return ""
    return project.take(source)
