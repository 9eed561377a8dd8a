"""`build` of Compose services -> CDFs; services that are built alike share one.

Takes a service's normal form; adds a CDF, and the folder that it is built with, to the experiment. Reads Dockerfiles.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from srprov import regular_file
from srprov.conversion.kept import Kept
from srprov.conversion.project import WRITTEN, Project
from srprov.conversion.withheld import is_withheld
from srprov.definitions import dockerfile
from srprov.definitions.model import NO_REGISTRY
from srprov.importing.position import Path

_ADDRESSES = ("git@", "github.com/", "service:")


def cdf(given: Mapping[str, Any], service: str, project: Project, at: Path) -> str:
    """Return the file name of the CDF that a service is built by; empty when it cannot be."""
    build, path = given["build"], (*at, "build")
    written = _dockerfile(build, service, project, path)
    if written is None:
        return ""
    definition = {"cdf": 1, "dockerfile": written}
    platforms = [str(one) for one in build.get("platforms") or ()] or list(filter(None, [given.get("platform")]))
    if platforms:
        definition["platforms"] = platforms
    if str(given.get("image", "")).startswith(f"{NO_REGISTRY}/"):
        project.notes.exact((*at, "image"))  # as exports call what they have built
    elif given.get("image"):
        project.notes.dropped((*at, "image"), "an image that is built is named after its content")
    for name, known in project.making.cdfs.items():
        if known == definition:
            project.notes.adapted(path, f"built as {name} says, which other services share")
            return name
    name = f"{project.names[service]}.cdf"
    project.making.cdfs[name] = definition
    project.notes.adapted(path, f"built as {name} says")
    return name


def _dockerfile(build: Mapping[str, Any], service: str, project: Project, path: Path) -> dict[str, Any] | None:
    """Return the long form of a CDF's `dockerfile`, and have its files copied."""
    context = str(build.get("context") or ".")
    place = _context_place(context, project, (*path, "context"))
    if not place:
        return None
    project.take(context)
    found: dict[str, Any] = {"context": place}
    text = _text(build, context, service, found, project, path)
    if text is None:
        return None
    if args := _args(build, text, project, path):
        found["args"] = args
    if build.get("target"):
        found["target"] = str(build["target"])
    return found


def _context_place(context: str, project: Project, path: Path) -> str:
    """Return where a build context goes; empty and refused where it cannot be copied."""
    if "://" in context or context.startswith(_ADDRESSES):
        hint = "clone it beside the Compose file, and name the folder"
        project.notes.refused(path, f"'{context[:80]}' is no folder", hint)
        return ""
    place = project.place(context)
    if place and os.path.isdir(project.path(context)):
        return place
    what, hint = project.outside(context, path), project.elsewhere(context)
    if place:
        what, hint = "is no folder", "copy it beside the Compose file"
    project.notes.refused(path, f"'{context[:80]}' {what}", hint)
    return ""


def _text(
    build: Mapping[str, Any], context: str, service: str, found: dict[str, Any], project: Project, path: Path
) -> str | None:
    """Return the Dockerfile's text, and say in `found` where it is, relative to the context."""
    inline = build.get("dockerfile_inline")
    if inline:
        own = f"{WRITTEN}/{project.names[service]}.dockerfile"
        project.making.texts[own] = str(inline)
        found["dockerfile"] = os.path.relpath(own, found["context"])
        return str(inline)
    named = str(build.get("dockerfile") or "Dockerfile")
    source = project.path(os.path.join(context, named))
    place = project.take(source)
    if not place:
        why = f"'{named[:80]}' {project.outside(os.path.join(context, named), (*path, 'dockerfile'))}"
        project.notes.refused((*path, "dockerfile"), why, project.elsewhere(source))
        return None
    if is_withheld(os.path.realpath(source), project.making.withheld):
        project.notes.refused((*path, "dockerfile"), f"'{named[:80]}' is the file of a secret", "name another file")
        return None
    found["dockerfile"] = os.path.relpath(place, found["context"])
    try:
        return regular_file.read_text(source, dockerfile.MAX_BYTES)
    except OSError as error:
        project.notes.refused((*path, "dockerfile"), f"'{named[:80]}' cannot be read: {error.strerror}")
        return None


def _args(build: Mapping[str, Any], text: str, project: Project, path: Path) -> dict[str, str]:
    declared, found = dockerfile.declared(text), {}
    for name, value in (build.get("args") or {}).items():
        if value is None:
            project.notes.dropped(
                (*path, "args", name), f"'{name}' has no value, and no environment is looked at", "write it"
            )
        elif name not in declared:
            project.notes.say((*path, "args", name), Kept.DROPPED, f"no ARG of the Dockerfile declares '{name}'")
        else:
            found[name] = str(value)
    return found
