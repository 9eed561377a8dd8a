"""A project's services together: implied names, networks and dependencies; profiles; what refers to nothing. Pure."""

from __future__ import annotations

import graphlib
from collections.abc import Iterator, Mapping, Sequence

from srprov.importing.compose.defaults import named, with_default
from srprov.importing.compose.forms import clean_target
from srprov.importing.compose.values import Value, grown, refuse
from srprov.importing.compose.variables import Variables

_KINDS = ("networks", "volumes", "configs", "secrets")
_NAMESPACES = ("network_mode", "ipc", "pid", "uts", "cgroup")


def implied(tree: Value, project: str, variables: Variables) -> Value:
    """Return a tree with what its services imply: the default network, dependencies, names of volumes and others."""
    given = services(tree)
    made = {name: _service(service, variables) for name, service in given.items()}
    entries = dict(tree.data)
    entries["services"] = (tree.get("services") or tree).of(made)
    networks = tree.get("networks")
    known = dict(networks.data) if networks is not None and isinstance(networks.data, dict) else {}
    uses = [s for s in made.values() if (n := s.get("networks")) is not None and "default" in n.data]
    if uses and "default" not in known:
        known["default"] = Value(None, uses[0].place)
    if known:
        entries["networks"] = (networks or tree).of(known)
    for kind in _KINDS:
        if kind in entries and isinstance(entries[kind].data, dict):
            things = {name: _called(item, name, project) for name, item in entries[kind].data.items()}
            entries[kind] = entries[kind].of(things)
    return tree.of(entries)


def services(tree: Value) -> Mapping[str, Value]:
    """Return the services of a project by name."""
    found = tree.get("services")
    return found.data if found is not None and isinstance(found.data, dict) else {}


def _called(value: Value, name: str, project: str) -> Value:
    thing = value if isinstance(value.data, dict) else value.of({})
    if (own := thing.get("name")) is not None and own.data is not None:
        return thing
    external = thing.get("external")
    is_external = external is not None and str(external.data).lower() in ("true", "1", "t")
    return thing.of({**thing.data, "name": Value(name if is_external else f"{project}_{name}", value.place)})


def _service(service: Value, variables: Variables) -> Value:
    entries = dict(service.data)
    if "network_mode" not in entries:
        networks = entries.get("networks")
        if networks is None or not networks.data:
            entries["networks"] = grown({"default": None}, service.place)
    if (mounts := entries.get("volumes")) is not None and isinstance(mounts.data, list):
        entries["volumes"] = mounts.of([clean_target(mount) for mount in mounts.data])
    if (policy := entries.get("pull_policy")) is not None and policy.data == "if_not_present":
        entries["pull_policy"] = policy.of("missing")
    if (build := entries.get("build")) is not None and isinstance(build.data, dict):
        entries["build"] = _build(build, variables)
    scale, deploy = entries.get("scale"), entries.get("deploy")
    if scale is not None and scale.data is not None and deploy is not None and deploy.get("replicas") is None:
        entries["deploy"] = with_default(deploy, replicas=scale.data)
    if depends := dict(_dependencies(entries)):
        entries["depends_on"] = (entries.get("depends_on") or service).of(depends)
    return service.of(entries)


def _build(build: Value, variables: Variables) -> Value:
    if build.get("dockerfile_inline") is None:
        build = with_default(build, dockerfile="Dockerfile")
    if (args := build.get("args")) is not None:
        build = build.of({**build.data, "args": named(args, variables, keep=False)})
    return build


def _dependencies(entries: Mapping[str, Value]) -> Iterator[tuple[str, Value]]:
    have = entries.get("depends_on")
    known = dict(have.data) if have is not None and isinstance(have.data, dict) else {}
    yield from known.items()
    for item, name, restart in _implied_dependencies(entries):
        if name not in known:
            known[name] = item
            wanted = {"condition": "service_started", "restart": restart, "required": True}
            yield name, Value(grown(wanted, item.at).data, item.at, item.place)


def _implied_dependencies(entries: Mapping[str, Value]) -> Iterator[tuple[Value, str, bool]]:
    for link in _texts(entries.get("links")):
        parts = link.data.split(":")
        yield link, parts[0] if len(parts) == 2 else link.data, True
    for key in _NAMESPACES:
        value = entries.get(key)
        if value is not None and isinstance(value.data, str) and value.data.startswith("service:"):
            yield value, value.data.removeprefix("service:"), True
    for volume in _texts(entries.get("volumes_from")):
        if not volume.data.startswith("container:"):
            yield volume, volume.data.partition(":")[0], False


def _texts(value: Value | None) -> Sequence[Value]:
    return [item for item in value.data if isinstance(item.data, str)] if value is not None else ()


def chosen(tree: Value, profiles: Sequence[str]) -> Value:
    """Return a tree without services whose profiles are off."""
    on = {}
    for name, service in services(tree).items():
        wanted = [item.data for item in _texts(service.get("profiles"))]
        if not wanted or "*" in profiles or any(profile in wanted for profile in profiles):
            on[name] = service
    return tree.of({**tree.data, "services": (tree.get("services") or tree).of(on)})


def in_order(tree: Value) -> None:
    """Check that services do not depend on one another in a circle.

    Raises:
        Refused: They do.
    """
    all_services = services(tree)
    graph = {
        name: [other for other in depends.data if other in all_services]
        for name, service in all_services.items()
        if (depends := service.get("depends_on")) is not None
    }
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        way: list[str] = error.args[1]
        message = f"services depend on one another in a circle: {' -> '.join(reversed(way))[:300]}"
        place = all_services[way[0]].get("depends_on") or all_services[way[0]]
        raise refuse(place, message, ("services", way[0], "depends_on")) from None


def used_only(tree: Value) -> Value:
    """Return a tree without networks, volumes, configs and secrets that no service uses."""
    entries = dict(tree.data)
    for kind, names in _used(tree).items():
        if kind in entries and isinstance(entries[kind].data, dict):
            left = {name: item for name, item in entries[kind].data.items() if name in names}
            entries[kind] = entries[kind].of(left)
            if not left:
                del entries[kind]
    return tree.of(entries)


def _used(tree: Value) -> dict[str, set[str]]:
    used: dict[str, set[str]] = {kind: set() for kind in (*_KINDS, "models")}
    for service in services(tree).values():
        for kind in ("networks", "models"):
            if (own := service.get(kind)) is not None:
                used[kind] |= set(own.data)
        for kind in ("configs", "secrets"):
            used[kind] |= _sources(service.get(kind))
        if (build := service.get("build")) is not None:
            used["secrets"] |= _sources(build.get("secrets"))
        mounts = [m for m in _items(service.get("volumes")) if (kind_of := m.get("type")) and kind_of.data == "volume"]
        used["volumes"] |= {str(source.data) for m in mounts if (source := m.get("source")) is not None}
    return used


def _items(value: Value | None) -> Sequence[Value]:
    return value.data if value is not None and isinstance(value.data, list) else ()


def _sources(value: Value | None) -> set[str]:
    return {str(source.data) for item in _items(value) if (source := item.get("source")) is not None}
