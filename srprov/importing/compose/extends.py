"""Services that begin as another service: of the same file, or of one that they name. Reads files."""

from __future__ import annotations

import os
from dataclasses import dataclass

import msgspec

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.compose import notes, paths
from srprov.importing.compose.forms import long
from srprov.importing.compose.loading import File, Loading, first_look
from srprov.importing.compose.merge import merged
from srprov.importing.compose.resets import Resets
from srprov.importing.compose.unique import unique
from srprov.importing.compose.values import Value, refuse
from srprov.importing.normal import Refused

LONGEST_CHAIN = 50
MOST_VALUES = 100_000
"""Of all services together, once they are extended: a chain of services may grow with each link."""


@dataclass
class _Extending:
    loading: Loading
    left: int = MOST_VALUES

    def count(self, value: Value, at: Value) -> None:
        self.left -= _size(value)
        if self.left < 0:
            raise refuse(at, f"with all that services extend, the project has more than {MOST_VALUES} values")


def extended(tree: Value, reset: Resets, file: File, loading: Loading) -> Value:
    """Return a file's tree without `extends`: each service has what it extends, with its own laid over it.

    Raises:
        Refused: A service extends itself, one that is not there, or a file that must not be read.
    """
    services = tree.get("services")
    if services is None:
        return tree
    if not isinstance(services.data, dict):
        raise refuse(services, "services is a map", ("services",))
    extending = _Extending(loading)
    done: dict[str, Value] = {}
    for name, service in services.data.items():
        if not isinstance(service.data, dict | None):
            raise refuse(service, "a service is a map", ("services", name))
        done[name] = _service(extending, name, _Services(services, file, reset), ())
    return tree.of({**tree.data, "services": services.of(done)})


class _Services(msgspec.Struct, frozen=True):
    """Services that name one another, and the file that they stand in."""

    all: Value
    file: File
    reset: Resets


def _service(extending: _Extending, name: str, among: _Services, chain: tuple[tuple[str, str], ...]) -> Value:
    service: Value = among.all.data[name]
    wish = service.get("extends")
    if wish is None:
        return service
    if (among.file.path, name) in chain or len(chain) > LONGEST_CHAIN:
        way = " -> ".join(link for _, link in (*chain, ("", name)))
        raise refuse(wish, f"services extend one another in a circle: {way[:300]}", ("services", name, "extends"))
    other, where = _wished(wish, name)
    base_of = among if where is None else _of_file(extending.loading, where, among)
    if other not in base_of.all.data or not isinstance(base_of.all.data[other].data, dict | None):
        message = f"there is no service '{other}' in {base_of.file.shown} to extend"
        raise refuse(wish, message, ("services", name, "extends"))
    base = _service(extending, other, base_of, (*chain, (among.file.path, name)))
    own = service.of({key: item for key, item in service.data.items() if key != "extends"})
    if base.data is None:
        return own
    base = among.reset.of_service(name).drop(base)
    extending.count(base, wish)
    return merged(base, own, ("services", name))


def _wished(wish: Value, name: str) -> tuple[str, Value | None]:
    """Return the name of the service that is wished for, and the file, if one is named."""
    if isinstance(wish.data, str):
        return wish.data, None
    service, file = wish.get("service"), wish.get("file")
    if service is None or not isinstance(service.data, str):
        raise refuse(wish, "extends needs the name of a service", ("services", name, "extends"))
    if file is not None and not isinstance(file.data, str):
        raise refuse(file, "this is no path of a file", ("services", name, "extends", "file"))
    return service.data, file


def _of_file(loading: Loading, where: Value, among: _Services) -> _Services:
    """Return the services of another file, with paths from the project's folder."""
    file = among.file.beside(loading.folder, where)
    loading.reading.beside(file.shown, file.path, where)
    if (file.path, file.shown) not in loading.bases:
        tree, reset = first_look(file, loading)
        loading.notes += notes.of_file(tree)
        tree = unique(long(unique(tree.of({"services": tree.get("services") or tree.of({})}))))
        tree = paths.moved(tree, os.path.relpath(os.path.dirname(file.path), loading.folder))
        services = tree.get("services")
        if services is None or not isinstance(services.data, dict):
            raise Refused([Diagnostic(where.at, f"'{where.data}' has no services", code=Code.COMPOSE)])
        loading.bases[file.path, file.shown] = services, reset
    return _Services(loading.bases[file.path, file.shown][0], file, loading.bases[file.path, file.shown][1])


def _size(value: Value) -> int:
    if isinstance(value.data, dict):
        return 1 + sum(_size(item) for item in value.data.values())
    return 1 + sum(_size(item) for item in value.data) if isinstance(value.data, list) else 1
