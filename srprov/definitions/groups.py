"""The inventory while it is being read: hosts, groups and their variables, with Ansible's rules of who inherits what.

Takes what the inventory files say, one fact at a time; gives each host's variables. Pure. Ansible's order, from weak
to strong: groups' variables in the inventory from `all` downwards, then `group_vars/all`, then `group_vars/*`
downwards, then the host's own in the inventory, then `host_vars/*`; on one level the higher `ansible_group_priority`,
then the later name, wins.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from srprov import names as names_rule
from srprov.codes import Code
from srprov.definitions import ranges
from srprov.errors import DefinitionError
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar

MOST_HOSTS = 10_000
_MOST_MEMBERSHIPS = 500_000
_MOST_VARIABLES = 500_000
"""Of hosts and of those in groups, all counted together: fifty for each of the most hosts."""

_MOST_LITERALS = 300_000
"""Characters of values that Python reads, with some for each of them: it takes a second for half a million."""
_OF_EACH = 8

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
        self.too_large = False
        """More was said than an inventory may hold: no further hosts are added, and what is here is not the whole."""
        self._memberships = 0
        self._variables = 0
        self._literals = 0

    def group(self, name: str) -> Group:
        """Return a group, made when it is new."""
        return self.groups.setdefault(name, Group(name))

    def add_hosts(self, place: Scalar, group: str, variables: Variables | None = None) -> None:
        """Add the host, or range of hosts, that a scalar names to a group, with variables of its own.

        What a line costs is counted before it is done: a few characters stand for thousands of hosts.
        """
        if self.too_large:
            return
        own = variables or {}
        try:
            text, port = ranges.split_port(place.text)
            count, names = ranges.count_and_names(text)
        except ValueError as error:
            self.findings.add(place, str(error), code=Code.INVENTORY)
            return
        if port is not None:
            own = {"ansible_port": (place, Scalar(place.source, place.line, place.column, str(port))), **own}
        if not self._has_room(place, count, count * len(own)):
            return
        members = self.group(group).hosts
        for name in names:
            host = self.hosts.get(name) or self._entry(name, place)
            if host is None:
                return
            if own:
                host.variables.update(own)
            members[name] = place

    def _has_room(self, place: Node, memberships: int, variables: int) -> bool:
        """Count what a line adds; where it is too much, that is a finding."""
        self._memberships += memberships
        self._variables += variables
        if self._memberships > _MOST_MEMBERSHIPS:
            self._overflow(place, f"hosts are in more than {_MOST_MEMBERSHIPS} groups, all counted together")
        elif self._variables > _MOST_VARIABLES:
            hint = "what all hosts of a group have is written once, as a variable of the group"
            self._overflow(place, f"hosts have more than {_MOST_VARIABLES} variables, all counted together", hint)
        return not self.too_large

    def has_room_for_literal(self, place: Node, length: int) -> bool:
        """Count a value that Python is to read; where those are too much together, that is a finding."""
        self._literals += length + _OF_EACH
        if self._literals > _MOST_LITERALS and not self.too_large:
            message = f"lists, maps and quoted values have more than {_MOST_LITERALS} characters, all counted together"
            self._overflow(place, message, "write the inventory as YAML")
        return not self.too_large

    def _overflow(self, place: Node, message: str, hint: str = "") -> None:
        self.too_large = True
        self.findings.add(place, message, (), hint, code=Code.TOO_LARGE)

    def refuse_too_large(self) -> None:
        """Go on only with what is whole.

        Raises:
            DefinitionError: More was said than an inventory may hold; with everything that was found until then.
        """
        if self.too_large:
            raise DefinitionError(self.findings.problems)

    def _entry(self, name: str, place: Scalar) -> HostEntry | None:
        """Make the entry of a host that is new; None and a finding where it cannot be."""
        if wrong := names_rule.fault("robot", name):
            hint = "a range is written robot[1:4]" if "[" in name else ""
            self.findings.add(place, wrong, (), hint, code=Code.INVENTORY)
            return None
        if len(self.hosts) >= MOST_HOSTS:
            self._overflow(place, f"there are more than {MOST_HOSTS} hosts")
            return None
        entry = self.hosts[name] = HostEntry(name, place)
        return entry

    def depths(self) -> dict[str, int]:
        """Return each group's longest distance from `all`; a group that contains itself is a finding."""
        depth = {name: int(name != "all") for name in self.groups}
        for name, children in self._top_down():
            for child in children:
                depth[child] = max(depth[child], depth[name] + 1)
        return depth

    def members(self) -> dict[str, set[str]]:
        """Return every group's hosts, those of its children too; `all` has every host.

        Raises:
            DefinitionError: As `refuse_too_large`.
        """
        found: dict[str, set[str]] = {}
        count = 0
        for name, children in reversed(self._top_down()):
            group = self.groups[name]
            # before they are joined: a host may come by each of the children
            count += 0 if name == "all" else len(group.hosts) + sum(len(found[child]) for child in children)
            if count > _MOST_MEMBERSHIPS:
                place = next(iter([*group.children.values(), *group.hosts.values()]))
                self._overflow(place, f"hosts are in more than {_MOST_MEMBERSHIPS} groups, all counted together")
                self.refuse_too_large()
            found[name] = set(group.hosts).union(*(found[child] for child in children))
        return {**found, "all": set(self.hosts)}

    def _top_down(self) -> list[tuple[str, list[str]]]:
        """Return groups with their children, each group before its children; what closes a circle is left out."""
        has_parent = {child for group in self.groups.values() for child in group.children}
        done: dict[str, list[str]] = {}
        for start in ("all", *sorted(self.groups.keys() - has_parent), *sorted(has_parent)):
            trail: dict[str, Iterator[str]] = {}
            left = [start] if start not in done and start in self.groups else []
            while left:
                name = left[-1]
                rest = trail.setdefault(name, iter(self.groups[name].children))
                child = next(rest, None)
                if child is None:
                    del trail[left.pop()]
                    kept = [one for one in self.groups[name].children if one not in trail and one != name]
                    done[name] = kept
                elif child in trail:
                    circle = " -> ".join([*left[left.index(child) :], child])
                    self.findings.add(
                        self.groups[name].children[child],
                        f"the group contains itself: {circle[:400]}",
                        code=Code.INVENTORY,
                    )
                elif child not in done:
                    left.append(child)
        return list(reversed(done.items()))

    def inherited(self, depths: dict[str, int], wanted: Collection[str]) -> Inherited:
        """Return what hosts have of their groups: of the variables, those that are `wanted`."""
        ordered = sorted(self.groups.values(), key=lambda g: (depths.get(g.name, 0), _priority(g), g.name))
        return Inherited(ordered, wanted)


class Inherited:
    """What hosts have of their groups, put together once for all that are in the same ones.

    Ten thousand hosts may be in fifty groups each, and every group may have each variable that is read.
    """

    def __init__(self, ordered: list[Group], wanted: Collection[str]) -> None:
        """Begin with groups from weak to strong, and the names of the variables that are read."""
        self._wanted = wanted
        self._rank = {group.name: rank for rank, group in enumerate(ordered)}
        self._said = [(self._read(group.variables), self._read(group.from_files)) for group in ordered]
        self._known: dict[frozenset[str], tuple[Variables, tuple[str, ...]]] = {}

    def effective(self, host: HostEntry, groups: frozenset[str]) -> tuple[Variables, tuple[str, ...]]:
        """Return a host's variables after inheritance, those that are read; and its groups as they are shown."""
        if groups not in self._known:
            self._known[groups] = self._of(groups), tuple(sorted(groups - {"all", "ungrouped"}))
        (inherited, shown), own, more = self._known[groups], self._read(host.variables), self._read(host.from_files)
        return ({**inherited, **own, **more} if own or more else inherited), shown

    def _of(self, groups: frozenset[str]) -> Variables:
        result: Variables = {}
        said = [self._said[rank] for rank in sorted(map(self._rank.__getitem__, groups))]
        for scope in (*(variables for variables, _ in said), *(from_files for _, from_files in said)):
            if scope:
                result.update(scope)
        return result

    def _read(self, scope: Variables) -> Variables:
        if len(scope) < len(self._wanted):
            return {key: value for key, value in scope.items() if key in self._wanted} if scope else scope
        return {key: scope[key] for key in self._wanted if key in scope}


def _priority(group: Group) -> int:
    given = group.from_files.get("ansible_group_priority") or group.variables.get("ansible_group_priority")
    return (nodes.as_int(given[1]) or 1) if given else 1


def variables_of(node: Map) -> Variables:
    """Return a map's entries as variables."""
    return {name: (node.keys[name], value) for name, value in node.entries.items()}
