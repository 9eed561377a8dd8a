"""What an experiment takes from the controller beyond its own folder: files that lie elsewhere, and variables.

Takes an EDF's containers and services; gives (service, what) pairs that `planning.policy` makes permissions of. Looks
where links lead.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Iterable, Iterator, Mapping

from srprov import regular_file
from srprov.definitions.container import Container
from srprov.definitions.merging import FROM_CONTROLLER
from srprov.definitions.model import Service
from srprov.definitions.paths import belongs, inside, is_closed
from srprov.definitions.version_control import ELSEWHERE
from srprov.definitions.ways import Ends, Way, way_to
from srprov.git_address import parse_address
from srprov.secret import Secret, Vault
from srprov.yamldoc.allowance import current
from srprov.yamldoc.nodes import Map

Taken = tuple[tuple[str, str], ...]
ANYBODY = "the experiment"
"""Whose a file is that no service names: its blank makes it no service's name."""


def outside(
    edf: str,
    folder: str,
    services: Mapping[str, Service],
    containers: Mapping[str, Container | None],
    env_files: Mapping[str, Collection[str]],
) -> Taken:
    """Return service -> path, links followed, of everything read or shipped that is not the experiment's own.

    Args:
        edf: Path of the EDF; one that is a link out of its folder counts for `ANYBODY`.
        folder: The experiment's folder.
        services: By name.
        containers: By the name of the service; None for an image.
        env_files: Service -> the paths of those that the EDF names.
    """
    found = {(ANYBODY, os.path.realpath(edf))} if not inside(edf, folder) else set()
    for name, service in services.items():
        container = containers.get(name)
        # what was fetched is asked for as what git fetches
        homes = (folder, *(container.fetched if container else ()))
        paths = [mount.source for mount in service.runtime.mounts if mount.kind in ("tree", "data") and mount.source]
        paths += [mount.seed.path for mount in service.runtime.mounts if mount.seed]
        paths += [*_of_container(container), *env_files.get(name, ())]
        found |= {(name, _named(path)) for path in paths if not any(belongs(path, home) for home in homes)}
        found |= {(name, _named(path)) for path in _local_repositories(container)}
    return tuple(sorted(found))


def repositories(remote: Iterable[tuple[str, str, str]]) -> Taken:
    """Return service -> path of the repositories with CDFs that are on this machine."""
    found = ((service, parse_address(url).path) for service, url, _ in remote)
    return tuple((service, _named(path)) for service, path in found if path)


def _of_container(container: Container | None) -> Iterator[str]:
    if container is None:
        return
    yield from container.files
    if container.definition.dockerfile:
        yield container.definition.dockerfile
        yield container.definition.context or os.path.dirname(container.definition.dockerfile)  # the build context
    for file in container.definition.files:
        yield file.source


def _local_repositories(container: Container | None) -> Iterator[str]:
    """Return the repositories on this machine: git follows what stands in one to anywhere, so each is outside."""
    for repository in container.definition.repositories if container is not None else ():
        if local := parse_address(repository.url).path:
            yield local


def _named(path: str) -> str:
    if is_closed(path):
        return left(path)
    real = os.path.realpath(path)
    return f"{real}/" if os.path.isdir(real) else in_words(real)


def left(path: str) -> str:
    """Return the name of what was not looked at: where links in the folder lead, and nothing of what is elsewhere.

    Of a file in the folder it says that it has other names: it may be there by an archive's doing.
    """
    limits = current.get()
    way = way_to(path, limits.homes[0]) if limits and limits.homes else Way(Ends.OUT, path)
    return way.place if way.ends is Ends.OUT else in_words(way.place)


def in_words(path: str) -> str:
    """Return a path, and of a file with several names that it has them: the one in the folder may be a stranger's."""
    with contextlib.suppress(OSError, ValueError):  # who reads it says so
        if regular_file.has_further_names(os.lstat(path)):
            return f"{path}: {ELSEWHERE}"
    return path


def environment(layer: Map | None) -> tuple[str, ...]:
    """Return the names of the variables in a merged layer whose values are the controller's."""
    given = layer.entries.get("environment") if layer is not None else None
    entries = given.entries if isinstance(given, Map) else {}
    return tuple(sorted(name for name, value in entries.items() if value.tag == FROM_CONTROLLER))


def variables(taken: Taken, environ: Mapping[str, str]) -> Vault:
    """Return the values of variables; from now on nothing shows them, but for those too short to be hidden."""
    values = {}
    for _, name in taken:
        with contextlib.suppress(ValueError, KeyError):
            values[name] = Secret(environ[name])
    return Vault(values)
