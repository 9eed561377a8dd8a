"""What the files of `env_file` say, in the `environment` of their service. Reads files."""

from __future__ import annotations

import os
from collections.abc import Mapping

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.compose import envfiles, finish
from srprov.importing.compose.loading import File, Loading
from srprov.importing.compose.origins import Origin
from srprov.importing.compose.values import Value
from srprov.importing.compose.variables import Variables
from srprov.importing.normal import Refused


def with_env_files(tree: Value, loading: Loading, first: File) -> Value:
    """Return a tree in which each service's environment has what its files of variables say; its own entries win.

    Raises:
        Refused: A file is not there, must not be read, or asks for a variable that has no value.
    """
    made = {name: _service(service, loading, first) for name, service in finish.services(tree).items()}
    services = tree.get("services")
    return tree if services is None else tree.of({**tree.data, "services": services.of(made)})


def _service(service: Value, loading: Loading, first: File) -> Value:
    service = _with_labels(service, loading, first)
    files = service.get("env_file")
    if files is None:
        return service
    own = service.get("environment")
    entries: dict[str, Value] = {}
    known = loading.variables.beside(_origins(own.data if own is not None else {}, "environment"))
    for item in files.data:
        entries |= _file(item, loading, first, known, entries)
    entries |= own.data if own is not None else {}
    environment = (own or files).of(entries)
    return service.of({**service.data, "environment": environment}) if entries else service


def _with_labels(service: Value, loading: Loading, first: File) -> Value:
    """Return a service with the labels that its `label_file` gives."""
    files, own = service.get("label_file"), service.get("labels")
    if files is None:
        return service
    entries: dict[str, Value] = {}
    for name in files.data:
        file = first.beside(loading.folder, name)
        text = loading.reading.variables(file.path, file.shown, name)
        found = envfiles.values(text, file.shown, loading.variables)
        entries |= {key: Value(value, at, at) for key, (value, at) in found.items()}
    labels = (own or files).of({**entries, **(own.data if own is not None else {})})
    return service.of({**{k: v for k, v in service.data.items() if k != "label_file"}, "labels": labels})


def _origins(entries: Mapping[str, Value], source: str) -> dict[str, Origin]:
    return {name: Origin(item.data, source) for name, item in entries.items() if isinstance(item.data, str)}


def _file(
    item: Value, loading: Loading, first: File, known: Variables, before: Mapping[str, Value]
) -> dict[str, Value]:
    name, required, form = item.get("path"), item.get("required"), item.get("format")
    assert name is not None
    file = first.beside(loading.folder, name)
    if not os.path.lexists(file.path):
        loading.reading.inside(file.path, name)
        if required is None or required.data:
            raise envfiles.missing(file)
        return {}
    if form is not None and form.data != "raw":
        raise Refused(
            [
                Diagnostic(
                    form.at,
                    f"Compose knows no format '{form.data}' of files of variables",
                    hint="known: raw",
                    code=Code.COMPOSE_VARIABLE,
                )
            ]
        )
    text = loading.reading.variables(file.path, file.shown, name)
    found = envfiles.values(text, file.shown, known, _origins(before, "env_file"), raw=form is not None)
    return {key: Value(value, at, at) for key, (value, at) in found.items()}
