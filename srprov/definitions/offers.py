"""Names in the user's files, for a command line that is being typed: services, profiles, robots, groups.

Takes a path; gives names that are valid, so that no shell sees anything else. Reads files within small limits, since
the user waits for each Tab. Nothing is checked but names, nothing is run, and what cannot be read gives nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from srprov import names
from srprov.definitions.groups import HostTree
from srprov.errors import DefinitionError
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq

_MOST_BYTES = 256 * 1024
_MOST_VALUES = 12_000
_MOST_REPLICAS = 100
_MOST_NAMES = 2000


def offered(path: str, what: str) -> tuple[str, ...]:
    """Return the `services` or `profiles` of an EDF, or the `robots` or `groups` of an inventory, sorted."""
    try:
        with allowance(_MOST_BYTES, _MOST_VALUES):
            found = _of_inventory(path, what) if what in ("robots", "groups") else _of_experiment(path, what)
    except (DefinitionError, OSError, ValueError, RecursionError):
        return ()
    rule = "service" if what == "services" else "robot"
    return tuple(sorted({name for name in found if names.valid(rule, name)})[:_MOST_NAMES])


def _of_experiment(path: str, what: str) -> list[str]:
    root = loader.read(path)
    services = root.entries.get("services") if isinstance(root, Map) else None
    if not isinstance(services, Map):
        return []
    every = services.entries.items()
    if what == "profiles":
        return [text for _, one in every for text in _texts(_entry(one, "profiles"))]
    return [text for name, one in every for text in (name, *_replicas(name, one))]


def _entry(node: Node, key: str) -> Node | None:
    return node.entries.get(key) if isinstance(node, Map) else None


def _texts(node: Node | None) -> Iterator[str]:
    some: Sequence[Node | None] = node.items if isinstance(node, Seq) else [node]
    for one in some:
        if isinstance(one, Scalar):
            yield one.text


def _replicas(name: str, node: Node) -> Iterator[str]:
    given = _entry(node, "replicas")
    count = (nodes.as_int(given) or 0) if given is not None else 0
    if 1 < count <= _MOST_REPLICAS:
        yield from (f"{name}-{number}" for number in range(1, count + 1))


def _of_inventory(path: str, what: str) -> list[str]:
    from srprov.definitions import inventory

    tree = HostTree()
    for part in inventory.files_of(path, tree):
        inventory.read_one(part, tree, may_run=False)
    return list(tree.hosts) if what == "robots" else list(tree.groups)
