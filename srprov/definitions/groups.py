"""The inventory while it is being read: hosts, groups and their variables, with Ansible's rules of who inherits what.

Takes what the inventory files say, one fact at a time; gives each host's variables. Pure. Ansible's order, from weak
to strong: groups' variables in the inventory from `all` downwards, then `group_vars/all`, then `group_vars/*`
downwards, then the host's own in the inventory, then `host_vars/*`; on one level the higher `ansible_group_priority`,
then the later name, wins.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from srprov import names as names_rule
from srprov.definitions import ranges
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar

Variables = dict[str, tuple[Scalar, Node]]
"""name -> (where its name stands, its value)"""


@dataclass
class Group:
    """One group: what the inventory says of it, and what `group_vars/` says."""

    name: str
    hosts: dict[str, Node] = field(default_factory=dict)
    children: dict[str, Node] = field(default_factory=dict)
    variables: Variables = field(default_factory=dict)
    from_files: Variables = field(default_factory=dict)


@dataclass
class HostEntry:
    """One host: where it was first named, what the inventory says of it, and what `host_vars/` says."""

    name: str
    place: Node
    variables: Variables = field(default_factory=dict)
    from_files: Variables = field(default_factory=dict)


class HostTree:
    """Hosts and groups by name; everything wrong goes to `findings`."""

    def __init__(self) -> None:
        """Begin with the group `all` and nothing in it."""
        self.groups: dict[str, Group] = {"all": Group("all")}
        self.hosts: dict[str, HostEntry] = {}
        self.findings = Findings()

    def group(self, name: str) -> Group:
        """Return a group, made when it is new."""
        return self.groups.setdefault(name, Group(name))

    def add_hosts(self, place: Scalar, group: str, variables: Variables | None = None) -> None:
        """Add the host, or range of hosts, that a scalar names to a group, with variables of its own."""
        try:
            text, port = ranges.split_port(place.text)
            names = ranges.expand(text)
        except ValueError as error:
            self.findings.add(place, str(error))
            return
        for name in names:
            if wrong := names_rule.fault("robot", name):
                hint = "a range is written robot[1:4]" if "[" in name else ""
                self.findings.add(place, wrong, (), hint)
                return
            host = self.hosts.setdefault(name, HostEntry(name, place))
            if port is not None:
                host.variables["ansible_port"] = (place, Scalar(place.source, place.line, place.column, str(port)))
            host.variables.update(variables or {})
            self.group(group).hosts[name] = place

    def depths(self) -> dict[str, int]:
        """Return each group's distance from `all`; a group that contains itself is a finding and stands at 0."""
        has_parent = {child for group in self.groups.values() for child in group.children}
        depth = {"all": 0}

        def place(name: str, level: int, trail: tuple[str, ...]) -> None:
            if name in trail:
                circle = " -> ".join([*trail[trail.index(name) :], name])
                self.findings.add(self.groups[trail[-1]].children[name], f"the group contains itself: {circle}")
                return
            if depth.get(name, -1) > level or (depth.get(name) == level and name != "all"):
                return
            depth[name] = level
            for child in self.groups[name].children:
                place(child, level + 1, (*trail, name))

        place("all", 0, ())
        for name in sorted(self.groups):
            if name not in has_parent and name != "all":
                place(name, 1, ("all",))
        for name in sorted(self.groups):  # what is left hangs on nothing but a cycle
            if name not in depth:
                place(name, 1, ())
        return depth

    def members(self) -> dict[str, set[str]]:
        """Return every group's hosts, those of its children too; `all` has every host."""
        found: dict[str, set[str]] = {}

        def of(name: str, trail: frozenset[str]) -> set[str]:
            if name not in found and name not in trail:
                group = self.groups[name]
                below = (of(child, trail | {name}) for child in group.children)
                found[name] = set(group.hosts).union(*below)
            return found.get(name, set())

        for name in self.groups:
            of(name, frozenset())
        return {**found, "all": set(self.hosts)}

    def effective(self, host: HostEntry, groups: set[str], depths: dict[str, int]) -> Variables:
        """Return a host's variables after inheritance."""
        ordered = sorted(
            (self.groups[name] for name in groups), key=lambda g: (depths.get(g.name, 0), _priority(g), g.name)
        )
        result: Variables = {}
        for group in ordered:
            result.update(group.variables)
        for group in ordered:
            result.update(group.from_files)
        result.update(host.variables)
        result.update(host.from_files)
        return result


def _priority(group: Group) -> int:
    given = group.from_files.get("ansible_group_priority") or group.variables.get("ansible_group_priority")
    return (nodes.as_int(given[1]) or 1) if given else 1


def variables_of(node: Map) -> Variables:
    """Return a map's entries as variables."""
    return {name: (node.keys[name], value) for name, value in node.entries.items()}
