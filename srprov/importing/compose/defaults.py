"""What Compose puts in where a key is left out, before services are looked at together. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from srprov.importing.compose.values import Rules, Value, rewrite
from srprov.importing.compose.variables import Variables
from srprov.importing.position import Path

Default = Callable[[Value], Value]


def put_in(tree: Value) -> Value:
    """Return a tree in long forms with defaults where Compose has some."""
    return rewrite(tree, _RULES, lambda rule, value, path: rule(value))


def without_empty(tree: Value) -> Value:
    """Return a tree without empty entries of `dns`, which Compose leaves out."""
    return rewrite(tree, _EMPTY, lambda rule, value, path: rule(value))


def with_default(value: Value, **defaults: object) -> Value:
    """Return a map with keys that it did not have."""
    if not isinstance(value.data, dict):
        return value
    return value.of({**{name: Value(data, value.at) for name, data in defaults.items()}, **value.data})


def _port(value: Value) -> Value:
    return with_default(value, protocol="tcp", mode="ingress")


def _secret(value: Value) -> Value:
    source = value.get("source")
    return value if source is None else with_default(value, target=f"/run/secrets/{source.data}")


def _build(value: Value) -> Value:
    return with_default(value, context=".")


def _device(value: Value) -> Value:
    return value if value.get("device_ids") is not None else with_default(value, count="all")


def _filled(value: Value) -> Value:
    if not isinstance(value.data, list):
        return value
    return value.of([item for item in value.data if item.data not in (None, "")])


_RULES = Rules(
    {
        "services.*.build": _build,
        "services.*.secrets.*": _secret,
        "services.*.ports.*": _port,
        "services.*.deploy.resources.reservations.devices.*": _device,
        "services.*.gpus.*": _device,
    }
)
_EMPTY = Rules({"services.*.dns": _filled})
_ASKING = Rules({"services.*.environment": True})


def environment(tree: Value, variables: Variables) -> Value:
    """Return a tree in which names alone in `environment` have the value of the variable, where there is one."""

    def one(rule: bool, value: Value, path: Path) -> Value:
        return named(value, variables, keep=True)

    return rewrite(tree, _ASKING, one)


def named(value: Value, variables: Variables, *, keep: bool) -> Value:
    """Return a map or list of `name=value` with values for names alone; without one they stay, or go."""
    if isinstance(value.data, dict):
        found = {
            name: _known(item, name, variables) if item.data is None else item for name, item in value.data.items()
        }
        return value.of({name: item for name, item in found.items() if keep or item.data is not None})
    if not isinstance(value.data, list):
        return value
    return value.of(list(_named_items(value.data, variables, keep=keep)))


def _named_items(items: Iterable[Value], variables: Variables, *, keep: bool) -> Iterator[Value]:
    for item in items:
        name = item.data
        if not isinstance(name, str) or "=" in name:
            yield item
            continue
        known = _known(item.of(None), name, variables)
        if known.data is not None:
            yield item.of(f"{name}={known.data}")
        elif keep:
            yield item


def _known(value: Value, name: str, variables: Variables) -> Value:
    origin = variables.worth.get(name)
    variables.record(name, origin.source if origin else "unset", origin.value if origin else "", value.place)
    return value.of(origin.value) if origin else value
