"""How one definition is laid over another: a CDF over the one it extends, a service over its CDF.

Takes two maps; gives one whose values still know the file and line that they come from. Pure. Maps merge, lists
append (an entry that is there already is not repeated), everything else replaces. `!replace` before a map or list
makes it replace as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from srprov.codes import Code
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

FROM_CONTROLLER = "!controller"
"""The tag of a value that the controller's environment gave; in a file it means nothing and is refused."""

REPLACED_LISTS = frozenset({"command", "entrypoint", "test", "authors", "arch"})
"""Lists that are one value: they replace."""

REPLACED_MAPS = frozenset({"logging"})
"""Maps that are one value: options of one driver mean nothing to another."""

KEYED = ("environment", "sysctls", "labels")
"""Given as a map or as a list of NAME=value; merged as a map."""

RUNTIME_MERGED = frozenset(
    (*KEYED, "volumes", "devices", "ports", "expose", "ulimits", "cap_add", "group_add", "security_opt")
) | {"device_cgroup_rules", "healthcheck", "cap_drop", "tmpfs", "extra_hosts", "data"}
"""Run-time fields in which a service is merged with its CDF."""

BUILD_MERGED = frozenset(
    ("packages", "apt", "pip", "npm", "repositories", "files", "run", "platforms", "requires", "tags")
)
"""Further fields in which a CDF is merged with the one that it extends."""


def merge(under: Node, over: Node, key: str = "") -> Node:
    """Lay `over` on `under`; `key` is the key that both stand at."""
    if over.tag == "!replace":
        return over
    if isinstance(under, Map) and isinstance(over, Map) and key not in REPLACED_MAPS:
        entries, keys = dict(under.entries), dict(under.keys)
        for name, value in over.entries.items():
            entries[name] = merge(entries[name], value, name) if name in entries else value
            keys[name] = over.keys[name]
        return Map(over.source, over.line, over.column, entries, keys)
    if isinstance(under, Seq) and isinstance(over, Seq) and key not in REPLACED_LISTS:
        present = {_plain(item) for item in over.items}
        kept = tuple(item for item in under.items if _plain(item) not in present)
        return Seq(over.source, over.line, over.column, kept + over.items)
    return over


def _plain(node: Node) -> object:
    """Return a comparable form of a node, without places."""
    if isinstance(node, Map):
        return tuple(sorted((key, _plain(value)) for key, value in node.entries.items()))
    return tuple(_plain(item) for item in node.items) if isinstance(node, Seq) else node.text


def normalise(layer: Map, environ: Mapping[str, str], findings: Findings, path: Path) -> Map:
    """Return a layer in the one form that merges: what is keyed as maps, `run` and `tmpfs` as lists."""
    entries = dict(layer.entries)
    for key in KEYED:
        if isinstance(entries.get(key), Seq):
            entries[key] = _as_map(entries[key], environ if key == "environment" else {}, findings, (*path, key))
    if (hosts := entries.get("extra_hosts")) is not None:
        entries["extra_hosts"] = _hosts(hosts)
    for key in ("run", "tmpfs"):
        if isinstance(one := entries.get(key), Scalar):
            entries[key] = Seq(one.source, one.line, one.column, (one,))
    return Map(layer.source, layer.line, layer.column, entries, layer.keys, layer.tag)


def _as_map(node: Node, environ: Mapping[str, str], findings: Findings, path: Path) -> Map:
    entries: dict[str, Node] = {}
    keys: dict[str, Scalar] = {}
    for index, item in enumerate(node.items if isinstance(node, Seq) else ()):
        assert isinstance(item, Scalar)
        name, given, value = item.text.partition("=")
        if name in entries:
            findings.add(
                item, f"'{name}' is given twice; already on line {entries[name].line}", (*path, index), code=Code.TWICE
            )
        if not given and name not in environ:
            hint = f"write {name}=value, or set {name} where srprov runs"
            findings.add(
                item, f"the controller's environment has no '{name}'", (*path, index), hint, code=Code.ENVIRONMENT
            )
        words = value if given else environ.get(name, "")
        tag = "" if given else FROM_CONTROLLER
        entries[name] = Scalar(item.source, item.line, item.column, words, plain=False, tag=tag)
        keys[name] = item
    return Map(node.source, node.line, node.column, entries, keys, node.tag)


def _hosts(node: Node) -> Node:
    """Return Compose's map, or list of `NAME:ADDRESS` and `NAME=ADDRESS`, as NAME -> addresses with blanks between."""
    entries: dict[str, Node] = {}
    keys: dict[str, Scalar] = {}
    for key, name, addresses in _host_lines(node):
        earlier = entries.get(name)
        words = f"{earlier.text} {addresses}" if isinstance(earlier, Scalar) else addresses
        entries[name] = Scalar(key.source, key.line, key.column, words)
        keys.setdefault(name, key)
    return Map(node.source, node.line, node.column, entries, keys, node.tag)


def _host_lines(node: Node) -> Iterator[tuple[Scalar, str, str]]:
    """Return the place, the name and the addresses of each entry."""
    if isinstance(node, Map):
        for name, value in node.entries.items():
            items = value.items if isinstance(value, Seq) else (value,)
            yield node.keys[name], name, " ".join(item.text for item in items if isinstance(item, Scalar))
    for item in node.items if isinstance(node, Seq) else ():
        if isinstance(item, Scalar):
            name, address = re.split("[=:]", item.text, maxsplit=1)
            yield item, name, address


def select(layer: Map, wanted: frozenset[str]) -> Map:
    """Return a map with only the wanted keys."""
    entries = {key: value for key, value in layer.entries.items() if key in wanted}
    return Map(layer.source, layer.line, layer.column, entries, {key: layer.keys[key] for key in entries}, layer.tag)
