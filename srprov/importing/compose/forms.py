"""Short forms of Compose -> long ones: what may be written in two ways is written in one after this. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from srprov.importing.compose import ports, volumes
from srprov.importing.compose.scalars import shown
from srprov.importing.compose.values import Rules, Value, grown, refuse, rewrite
from srprov.importing.position import Path
from srprov.yamldoc.allowance import current

_STARTED = {"condition": "service_started", "required": True}
Form = Callable[[Value, Path], Value]


def _keyed(value: Value, data: Mapping[str, Any]) -> Value:
    """Return a map in place of a short form, at its place."""
    return Value(grown(data, value.at).data, value.at, value.key)


def _one_field(name: str) -> Form:
    """Return a form: a text stands for a map with one field."""
    return lambda value, path: _keyed(value, {name: value.data}) if isinstance(value.data, str) else value


def _names(entry: Mapping[str, Any] | None) -> Form:
    """Return a form: a list of names stands for a map of them, each with the same entry."""

    def form(value: Value, path: Path) -> Value:
        if not isinstance(value.data, list):
            return value
        return value.of({str(item.data): Value(grown(entry, item.at).data, item.at, item.at) for item in value.data})

    return form


def _dependencies(value: Value, path: Path) -> Value:
    value = _names(_STARTED)(value, path)
    if not isinstance(value.data, dict):
        return value
    required = {name: item for name, item in value.data.items() if isinstance(item.data, dict)}
    return value.of({n: i.of({"required": Value(True, i.at), **i.data}) for n, i in required.items()})


def _list(value: Value, path: Path) -> Value:
    return value.of([Value(value.data, value.at)]) if isinstance(value.data, str) else value


def _env_files(value: Value, path: Path) -> Value:
    files = _list(value, path)
    if not isinstance(files.data, list):
        return value
    entries = [_one_field("path")(item, path) for item in files.data]
    return files.of(
        [i.of({"required": Value(True, i.at), **i.data}) if isinstance(i.data, dict) else i for i in entries]
    )


def _mount(value: Value, path: Path) -> Value:
    """A long form keeps its target as it is written until no two are compared any more."""
    return clean_target(_keyed(value, volumes.parse(value, path))) if isinstance(value.data, str) else value


def clean_target(mount: Value) -> Value:
    """Return a mount whose target has no `..` and no slash at its end."""
    target = mount.get("target")
    if target is None or not isinstance(target.data, str):
        return mount
    return mount.of({**mount.data, "target": target.of(volumes.clean(target.data))})


def _count(item: Value, values: int, path: Path) -> None:
    """Count what a short text became with what is read: ranges of ports are long."""
    left = current.get()
    if left is not None:
        left.values -= values
        if left.values < 0:
            raise refuse(item, "the project publishes too many ports", path, "network_mode: host needs no list of them")


def _ports(value: Value, path: Path) -> Value:
    entries: list[Value] = []
    for number, item in enumerate(value.data if isinstance(value.data, list) else ()):
        if isinstance(item.data, dict):
            entries.append(item)
        elif isinstance(item.data, str) or (isinstance(item.data, int) and not isinstance(item.data, bool)):
            found = ports.parse(item, str(item.data), (*path, number))
            _count(item, 4 * len(found), path)
            entries += [_keyed(item, port) for port in found]
        else:
            raise refuse(item, f"'{shown(item.data)}' is no port", (*path, number))
    return value.of(entries)


def _device(value: Value, path: Path) -> Value:
    if not isinstance(value.data, str):
        return value
    parts = value.data.split(":")
    if len(parts) > 3:
        raise refuse(value, f"the device '{value.data[:100]}' has too many colons", path, "write it in its long form")
    source, target, permissions = (*parts, "", "")[:3]
    return _keyed(value, {"source": source, "target": target or source, "permissions": permissions or "rwm"})


def _gpus(value: Value, path: Path) -> Value:
    if value.data == "all":
        return value.of([grown({"count": "all"}, value.at)])
    return value


def _external(value: Value, path: Path) -> Value:
    """Return `external: {name: x}` as Compose has it since: `external: true` and `name: x`."""
    external = value.get("external")
    if external is None or not isinstance(external.data, dict):
        return value
    own, old = value.get("name"), external.get("name")
    if own is not None and old is not None and own.data != old.data:
        raise refuse(external, f"there are two names, '{own.data}' and '{old.data}'", path)
    names = {"name": old} if old is not None and own is None else {}
    return value.of({**value.data, **names, "external": Value(True, external.at, external.key)})


def _pairs(value: Value, path: Path) -> Value:
    """Return `[name=value, …]` as a map."""
    if not isinstance(value.data, list):
        return value
    entries: dict[str, Value] = {}
    for item in value.data:
        name, sign, text = shown(item.data).partition("=")
        entries[name] = Value(text if sign else None, item.at, item.at)
    return value.of(entries)


_FORMS: Mapping[str, Form] = {
    "services.*.build": _one_field("context"),
    "services.*.build.additional_contexts": _pairs,
    "services.*.build.secrets.*": _one_field("source"),
    "services.*.configs.*": _one_field("source"),
    "services.*.depends_on": _dependencies,
    "services.*.devices.*": _device,
    "services.*.dns": _list,
    "services.*.env_file": _env_files,
    "services.*.extends": _one_field("service"),
    "services.*.gpus": _gpus,
    "services.*.label_file": _list,
    "services.*.models": _names(None),
    "services.*.networks": _names(None),
    "services.*.ports": _ports,
    "services.*.secrets.*": _one_field("source"),
    "services.*.volumes.*": _mount,
    "configs.*": _external,
    "networks.*": _external,
    "secrets.*": _external,
    "volumes.*": _external,
}
_RULES = Rules(_FORMS)


def long(tree: Value) -> Value:
    """Return a project's tree in long forms.

    Raises:
        Refused: A short form is none that Compose knows.
    """
    return rewrite(tree, _RULES, lambda form, value, path: form(value, path))
