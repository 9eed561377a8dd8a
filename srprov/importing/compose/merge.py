"""One Compose file over another, and a service over the one that it extends.

Maps unite, lists grow, the rest is replaced. What differs from that has a rule by its path.
Takes trees; gives a tree, or `Refused`. Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from srprov.importing.compose.scalars import shown
from srprov.importing.compose.values import Rules, Value, grown, refuse
from srprov.importing.position import Path

Merger = Callable[[Value, Value, Path, "Rules | None"], Value]


def merged(base: Value, over: Value, path: Path = ()) -> Value:
    """Return a tree with another laid over it; `path` is where both stand in a project.

    Raises:
        Refused: A map or list would be replaced by something else.
    """
    rules: Rules | None = _RULES
    for part in path:
        rules = rules and rules.step(part)
    return _merge(base, over, path, rules)


def _merge(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    if rules is not None and rules.here is not None:
        merger: Merger = rules.here
        return merger(base, over, path, rules)
    if over.data is None:
        return base
    if isinstance(base.data, dict):
        if not isinstance(over.data, dict):
            raise _cannot(over, "a map", path)
        return _maps(base, over, path, rules)
    if isinstance(base.data, list):
        if not isinstance(over.data, list):
            raise _cannot(over, "a list", path)
        return over.of([*base.data, *over.data])
    return over


def _cannot(over: Value, what: str, path: Path) -> Exception:
    return refuse(over, f"this would replace {what} of the file before", path, "use !override to replace it")


def _maps(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    entries = dict(base.data)
    for name, item in over.data.items():
        if name in entries:
            entries[name] = _merge(entries[name], item, (*path, name), rules and rules.step(name))
        else:
            entries[name] = item
    return over.of(entries)


def _replace(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    return over


def sequence(value: Value) -> list[Value]:
    """Return a list of `name=value`, whichever way it is written."""
    if isinstance(value.data, dict):
        entries: list[Value] = []
        for name, item in value.data.items():
            values = item.data if isinstance(item.data, list) else [item]
            entries += [Value(name if one.data is None else f"{name}={shown(one.data)}", one.at) for one in values]
        return sorted(entries, key=lambda entry: str(entry.data))
    if isinstance(value.data, list):
        return list(value.data)
    return [value] if isinstance(value.data, str) else []


def _sequences(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    return over.of([*sequence(base), *sequence(over)])


def _hosts(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    have = sequence(base)
    names = {str(entry.data) for entry in have}
    return over.of([*have, *(entry for entry in sequence(over) if str(entry.data) not in names)])


def _named(value: Value, entry: Mapping[str, object] | None, path: Path) -> Value:
    if isinstance(value.data, list):
        names = [item for item in value.data if isinstance(item.data, str)]
        return value.of({item.data: Value(grown(entry, item.at).data, item.at, item.at) for item in names})
    if isinstance(value.data, dict):
        return value
    return value.of({})


def _names(entry: Mapping[str, object] | None) -> Merger:
    """Return a merger of two maps, or of lists of names that stand for maps."""

    def merge(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
        return _maps(_named(base, entry, path), _named(over, entry, path), path, rules)

    return merge


def _build(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    def build(value: Value) -> Value:
        if isinstance(value.data, str):
            return value.of({"context": Value(value.data, value.at)})
        return value if isinstance(value.data, dict) else value.of({})

    return _maps(build(base), build(over), path, rules)


def _logging(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    """Options are those of a driver: another driver has others."""
    if not isinstance(base.data, dict) or not isinstance(over.data, dict):
        raise refuse(over, "logging is a map", path)
    one, other = base.get("driver"), over.get("driver")
    if one is not None and other is not None and one.data != other.data:
        return over
    return _maps(base, over, path, rules)


def _subnets(base: Value, over: Value, path: Path, rules: Rules | None) -> Value:
    """Entries with the same subnet are one."""
    if not isinstance(base.data, list) or not isinstance(over.data, list):
        raise refuse(over, "this is a list of subnets", path)
    if strange := next((one for one in [*base.data, *over.data] if not isinstance(one.data, dict)), None):
        raise refuse(strange, "this is a map with a subnet", path)
    values = len(over.data) * sum(map(_count, base.data)) + len(base.data) * sum(map(_count, over.data))
    if values > _MOST_OF_SUBNETS:
        raise refuse(over, "with those of the file before, these are more subnets than a network has", path)
    result: dict[object, Value] = {}
    for one in base.data:
        for other in over.data:
            if _subnet(one) != _subnet(other) and _subnet(other) not in result:
                result[_subnet(other)] = other
            else:
                entry = _maps(one, other, path, None)
                result[_subnet(entry)] = entry
    return over.of(list(result.values()))


def _subnet(entry: Value) -> object:
    subnet = entry.get("subnet")
    data = subnet.data if subnet is not None else None
    return id(data) if isinstance(data, dict | list) else data


def _count(value: Value) -> int:
    inner = value.data.values() if isinstance(value.data, dict) else value.data
    return 1 + (sum(map(_count, inner)) if isinstance(value.data, dict | list) else 0)


_MOST_OF_SUBNETS = 20_000
"""Values of all subnets of a network's two files, each as often as the other has subnets: that is how they unite."""
_SEQUENCES = """networks.*.labels volumes.*.labels services.*.annotations services.*.build.args
    services.*.build.additional_contexts services.*.build.labels services.*.deploy.labels services.*.dns
    services.*.dns_opt services.*.dns_search services.*.env_file services.*.label_file services.*.environment
    services.*.labels services.*.volumes.*.volume.labels services.*.sysctls services.*.tmpfs"""
_RULES = Rules(
    {
        **dict.fromkeys(_SEQUENCES.split(), _sequences),
        **dict.fromkeys(
            ["services.*.command", "services.*.entrypoint", "services.*.healthcheck.test", "services.*.ulimits.*"],
            _replace,
        ),
        "networks.*.ipam.config": _subnets,
        "services.*.build": _build,
        "services.*.build.extra_hosts": _hosts,
        "services.*.depends_on": _names({"condition": "service_started", "required": True}),
        "services.*.extra_hosts": _hosts,
        "services.*.logging": _logging,
        "services.*.models": _names(None),
        "services.*.networks": _names(None),
    }
)
