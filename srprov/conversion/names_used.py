"""The names by which services reach each other: which of those that Compose gives a service are used, and kept.

Takes a project; gives a `hostname` for each service that needs one. An overlay knows a service by its own name and by
one `hostname`; Compose by container names and aliases too. Pure.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from srprov.conversion.project import Project
from srprov.importing.position import Path

_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]{0,61}[A-Za-z0-9])?")
_WORD = re.compile(
    r"""(?:^|(?<=//)|(?<=[\s,;=@(\["']))(?P<host>[A-Za-z0-9_][A-Za-z0-9_.-]*)(?=[\s,;/)\]"']|:[0-9]|\Z)"""
)
"""What may be the name of a host: after the beginning, `//`, `@`, `=` or a blank; before a port, `/` or the end."""
_FURTHER = "a service has one 'hostname'; use the service's own name in the file"


def on_overlay(given: Mapping[str, Any]) -> bool:
    """Return whether a service has names that others can use at all."""
    mode = str(given.get("network_mode") or "")
    return mode in ("", "bridge", "default")


def hostnames(project: Project) -> dict[str, str]:
    """Return service (as Compose has it) -> its `hostname`; what cannot be kept is noted."""
    services: Mapping[str, Mapping[str, Any]] = project.document.get("services") or {}
    used_words = {name: words(given) for name, given in services.items()}
    uses = Counter(word for some in used_words.values() for word in some)
    all_links = links(services)
    found: dict[str, str] = {}
    for name, given in services.items():
        at = ("services", name)
        used = {
            alias: path
            for alias, path in further(name, project, all_links.get(name, ()))
            if uses[alias] > (alias in used_words[name]) and alias != project.names[name]
        }
        own = str(given.get("hostname") or "")
        if own == project.names[name]:
            own = ""  # it has that name anyway
            if used:
                project.notes.adapted((*at, "hostname"), "others reach it by that name; its own is another now")
        for alias, path in used.items():
            project.notes.adapted(path, f"others use the name '{alias}': it is the service's 'hostname'")
        if len({*used, *filter(None, [own])}) > 1:
            more = next(alias for alias in used if alias != own)
            project.notes.refused(used[more], f"'{more}' is used by other services, beside another name", _FURTHER)
        chosen = own or next(iter(used), "")
        why = _not_possible(chosen, name, given, project, {*found.values()})
        if chosen and why and used:
            project.notes.refused(used[next(iter(used))], f"other services use '{chosen}', but {why}", _FURTHER)
        elif own and why:
            project.notes.dropped((*at, "hostname"), why)
        elif chosen and chosen != project.names[name]:
            found[name] = chosen
        _addresses(name, given, project, uses)
    return found


def _not_possible(chosen: str, name: str, given: Mapping[str, Any], project: Project, known: set[str]) -> str:
    """Return why a service cannot have a `hostname`, or nothing."""
    if not chosen:
        return ""
    if not on_overlay(given):
        return f"a service with 'network: {given['network_mode']}' has no name of its own"
    if replicas(given) != 1 or (given.get("deploy") or {}).get("mode") == "global":
        return "several instances of a service cannot have one name"
    if not _HOST.fullmatch(chosen):
        return f"'{chosen[:60]}' is no host's name"
    taken = {*project.names.values(), *project.making.services} - {project.names[name]}
    if chosen in taken | known or chosen in {one.get("hostname") for one in project.making.services.values()}:
        return f"'{chosen}' is the name of another service"
    return ""


def replicas(given: Mapping[str, Any]) -> int:
    """Return how many of a service run."""
    deploy = given.get("deploy") or {}
    wanted = given.get("scale") if given.get("scale") is not None else deploy.get("replicas")
    return 1 if wanted is None else int(wanted)


def links(services: Mapping[str, Mapping[str, Any]]) -> dict[str, list[tuple[str, Path]]]:
    """Return service -> the names by which others link to it, each with its place."""
    found: dict[str, list[tuple[str, Path]]] = {}
    for other, entry in services.items():
        for link in entry.get("links") or ():
            target, _, alias = str(link).partition(":")
            if alias not in ("", target):
                found.setdefault(target, []).append((alias, ("services", other, "links")))
    return found


def further(name: str, project: Project, linked: Iterable[tuple[str, Path]]) -> Iterator[tuple[str, Path]]:
    """Yield the further names that Compose gives a service, each with its place; `linked` are those of links."""
    services: Mapping[str, Mapping[str, Any]] = project.document.get("services") or {}
    given, at = services[name], ("services", name)
    if not on_overlay(given):
        return
    if name != project.names[name]:
        yield name, at
    if given.get("container_name"):
        yield str(given["container_name"]), (*at, "container_name")
    else:
        whole = str(project.document.get("name"))
        for one in (f"{whole}-{name}-1", f"{whole}_{name}_1", f"{name}_1", f"{name}-1"):
            if one not in services:
                yield one, at
    for network, settings in (given.get("networks") or {}).items():
        for alias in (settings or {}).get("aliases") or ():
            if alias != name:
                yield str(alias), (*at, "networks", network, "aliases")
    yield from linked


def _addresses(name: str, given: Mapping[str, Any], project: Project, words: Collection[str]) -> None:
    for network, settings in (given.get("networks") or {}).items():
        for key in ("ipv4_address", "ipv6_address"):
            address = str((settings or {}).get(key) or "")
            if address and address in words:
                path = ("services", name, "networks", network, key)
                hint = f"use the service's name, {project.names[name]}"
                project.notes.refused(
                    path, f"the address {address[:40]} is used in the file, and will be another", hint
                )


def words(given: Mapping[str, Any]) -> set[str]:
    """Return all words in a service's texts that may be a host's name."""
    texts = [str(value) for value in (given.get("environment") or {}).values() if value]
    for key in ("command", "entrypoint"):
        texts += [str(word) for word in given.get(key) or ()]
    texts += [str(word) for word in (given.get("healthcheck") or {}).get("test") or ()]
    return {match["host"].rstrip(".") for text in texts for match in _WORD.finditer(text)}
