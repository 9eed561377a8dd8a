"""Ansible inventories -> Inventory.

Takes paths (YAML, INI, a program, a folder of them, or `robot1,robot2,`); gives hosts and groups with what srprov
reads of their variables. Touches files, for reading: the inventories, and `host_vars/` and `group_vars/` beside them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions import host_values, hostvars, inifile, names_alone, right_kind, script, unseen
from srprov.definitions.groups import Group, HostEntry, HostTree, Variables, variables_of
from srprov.definitions.hiding import hide_outside
from srprov.definitions.model import Inventory
from srprov.definitions.paths import folder_of, lies_open, link_out, way_out
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Map, Node, Scalar, Source

_NOT_INVENTORIES = (".orig", ".cfg", ".retry", ".swp", ".md", ".rst", ".txt")
"""Beside what is not shown, see `unseen.is_shown`."""
_LOOKS_LIKE_YAML = re.compile(r"---|[{%]|.*:(\s|$)|-\s")
_NAME_IT = "if you trust it, name it yourself: -i FILE, or its whole path in your own ~/.config/srprov/srprov.toml"
_MOST_BYTES = 16 * 1024 * 1024
_MOST_VALUES = 120_000
"""Of all files of the inventory; a thousand robots need a sixth."""
_MOST_FILES = 1000
"""Of one host or group."""
_GROUP_KEYS = ("hosts", "vars", "children")


def load(paths: Sequence[str], unnamed: Collection[str] = (), *, run: bool = True) -> Inventory:
    """Read inventories; of two that say different things the later wins.

    One of `unnamed` was not named by the user himself: no program, nor reached by one. Without `run`, none is run.

    Raises:
        DefinitionError: With everything that is wrong, in every file.
    """
    if link := next(filter(None, map(way_out, unnamed)), ""):
        message = f"'{link}' is a link that leads out of this folder, and you did not name this inventory"
        raise DefinitionError([Diagnostic(Location(link), message, hint=_NAME_IT, code=Code.UNNAMED_INVENTORY)])
    folders = tuple(dict.fromkeys(_folder(path) for path in paths if not names_alone.are_names(path)))
    try:
        names_alone.check_nothing_beside(paths, folders)
        with allowance(_MOST_BYTES, _MOST_VALUES):
            tree = _tree(paths, folders, unnamed, run=run)
            return _finish(tree, os.path.abspath(paths[0]) if paths else "", may_run=not unnamed)
    except DefinitionError as error:
        problems = [nodes.without_secrets(one) for one in error.problems]
        told = (folder_of(path) if link_out(path) else _folder(path) for path in paths)
        raise DefinitionError(hide_outside(problems, *told)) from None


def _tree(paths: Sequence[str], folders: Sequence[str], unnamed: Collection[str], *, run: bool) -> HostTree:
    tree = HostTree()
    for path in paths:
        for part in files_of(path, tree):
            try:
                _check_place(part, path if path in unnamed else "")
                read_one(part, tree, may_run=run and part == path and path not in unnamed)
            except DefinitionError as error:
                tree.findings.extend(error.problems)
    tree.refuse_too_large()
    for folder in folders:
        _read_variables(folder, tree, next((path for path in unnamed if _folder(path) == folder), ""))
    return tree


def _finish(tree: HostTree, source: str, *, may_run: bool) -> Inventory:
    values = host_values.Values()
    for variables in _scopes(tree):
        host_values.check_own(variables, values, tree.findings)
    depths, members = tree.depths(), tree.members()
    inherited, hosts = tree.inherited(depths, hostvars.READ), {}
    for name, groups in sorted(_groups_of(tree.hosts, members).items()):
        effective, shown = inherited.effective(tree.hosts[name], frozenset(groups))
        hosts[name] = one = hostvars.host(tree.hosts[name], effective, shown, values, tree.findings)
        if not may_run and hostvars.needs_trust(one):
            has = "a password, a key, ssh options or a site"
            message = f"'{name}' has {has}, or is this machine: name this inventory yourself"
            tree.findings.add(tree.hosts[name].place, message, (), _NAME_IT, code=Code.UNNAMED_INVENTORY)
    if tree.findings.problems:
        raise DefinitionError(tree.findings.problems)
    by_group = {name: tuple(sorted(contained)) for name, contained in sorted(members.items())}
    own, by_name = hostvars.own_files(_scopes(tree), hosts.values()), MappingProxyType(hosts)
    return Inventory(hosts=by_name, groups=MappingProxyType(by_group), source=source, own_files=own, named=may_run)


def _groups_of(hosts: Iterable[str], members: Mapping[str, Iterable[str]]) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {name: set() for name in hosts}
    for group, contained in members.items():
        for name in contained:
            found[name].add(group)
    return found


def _folder(path: str) -> str:
    return path if os.path.isdir(path) else os.path.dirname(path) or "."


def files_of(path: str, tree: HostTree) -> list[str]:
    """Return the inventory files that a path stands for, in name order for a folder."""
    if names_alone.are_names(path):
        for name in names_alone.split(path):
            tree.add_hosts(Scalar(Source(path), 1, 1, name), "ungrouped")
        return []
    if not os.path.isdir(path):
        return [path]
    names = sorted(name for name in filter(unseen.is_shown, os.listdir(path)) if not name.endswith(_NOT_INVENTORIES))
    return [unseen.shown(one, path) for name in names if os.path.isfile(one := os.path.join(path, name))]


def read_one(path: str, tree: HostTree, *, may_run: bool) -> None:
    """Add one inventory file, whatever its kind; a program runs only when the user named this very file."""
    if script.is_program(path):
        if not may_run:
            message = "is a program, and only an inventory that you name yourself as one is run"
            raise DefinitionError([Diagnostic(Location(path), message, hint=_NAME_IT, code=Code.UNNAMED_INVENTORY)])
        script.read(path, tree)
        return
    unseen.check(text := loader.read_text(path), path)
    names_alone.check_whole(path, text)
    first = next((line for line in map(str.strip, text.splitlines()) if line and line[0] not in "#;"), "")
    called_yaml = path.endswith((".yml", ".yaml", ".json"))
    if called_yaml or (not path.endswith((".ini", ".cfg")) and _LOOKS_LIKE_YAML.match(first)):
        _read_yaml(loader.parse(text, path), path, tree)
    else:
        inifile.read(text, path, tree)


def _read_yaml(root: Node | None, path: str, tree: HostTree) -> None:
    if root is None:
        return
    right_kind.check(root, "inventory", path)
    unseen.check_keys(None if names_alone.is_of_record(path) else root)
    if not isinstance(root, Map):
        message = f"an inventory is a map of groups, not {nodes.kind(root)}"
        raise DefinitionError([nodes.problem(root, message, "", "begin with all:", code=Code.INVENTORY)])
    if "plugin" in root.entries:
        hint = "write the hosts themselves; or name a program of your own that prints them, as JSON"
        message = "an inventory plugin's settings are no inventory"
        raise DefinitionError([nodes.problem(root.keys["plugin"], message, "", hint, code=Code.INVENTORY)])
    for name, group in root.entries.items():
        if not name.startswith("x-"):
            _read_group(root.keys[name], group, tree, (name,))


def _read_group(key: Scalar, node: Node, tree: HostTree, path: nodes.Path) -> None:
    name = key.text
    tree.group(name)
    if nodes.is_null(node):
        return
    if not isinstance(node, Map):
        message = f"the group '{name}' is a map of hosts, vars and children, not {nodes.kind(node)}"
        tree.findings.add(node, message, path, code=Code.INVENTORY)
        return
    for part, value in node.entries.items():
        if part in _GROUP_KEYS:
            _read_part(name, part, value, tree, (*path, part))
        elif not part.startswith("x-"):
            hint = did_you_mean(part, _GROUP_KEYS) or "a group has hosts, vars and children"
            message = f"unknown key '{part[:60]}' in the group '{name}'"
            tree.findings.add(node.keys[part], message, (*path, part), hint, code=Code.INVENTORY)


def _read_part(group: str, part: str, node: Node, tree: HostTree, path: nodes.Path) -> None:
    if nodes.is_null(node):
        return
    if isinstance(node, Scalar) and part == "hosts":
        tree.add_hosts(node, group)
        return
    if not isinstance(node, Map):
        hint = "write each name with a colon behind it" if part != "vars" else ""
        tree.findings.add(node, f"'{part}' is a map, not {nodes.kind(node)}", path, hint, code=Code.INVENTORY)
        return
    if part == "vars":
        tree.group(group).variables.update(variables_of(node))
        return
    for name, value in node.entries.items():
        key = node.keys[name]
        if part == "children":
            tree.group(group).children[name] = key
            _read_group(key, value, tree, (*path, name))
        elif isinstance(value, Map) or nodes.is_null(value):
            tree.add_hosts(key, group, variables_of(value) if isinstance(value, Map) else None)
        else:
            message = f"the host '{name}' is a map of variables, not {nodes.kind(value)}"
            tree.findings.add(value, message, (*path, name), code=Code.INVENTORY)


def _check_place(path: str, unnamed: str) -> None:
    """Raise for a file that an inventory which the user did not name would read elsewhere by a link of any kind."""
    if unnamed and os.path.lexists(path) and not lies_open(path, folder := _folder(unnamed)):
        message = f"'{os.path.relpath(path, folder)}' lies elsewhere, or is linked there, and you did not name it"
        where = Location(folder if path == unnamed else unnamed)  # of the file itself nothing is shown
        raise DefinitionError([Diagnostic(where, message, hint=_NAME_IT, code=Code.UNNAMED_INVENTORY)])


def _read_variables(folder: str, tree: HostTree, unnamed: str) -> None:
    """Add `group_vars/` and `host_vars/` of one folder; of an inventory `unnamed` only what lies in its folder."""
    for kind, holders in (("group_vars", tree.groups), ("host_vars", tree.hosts)):
        beside = os.path.normpath(os.path.join(folder, kind))
        for name, holder in holders.items() if os.path.isdir(beside) else ():
            holder.from_files.update(_variables(beside, name, tree, unnamed))


def _variables(folder: str, name: str, tree: HostTree, unnamed: str) -> Variables:
    """Read a host's or group's file, or every file of its folder; one that is wholly a vault says nothing to us."""
    found: Variables = {}
    if not name or "/" in name or name[-1] == "~":  # a copy, also with `.yml` behind it
        return found
    for file in filter(unseen.is_shown, (name + suffix for suffix in ("", ".yml", ".yaml", ".json"))):
        path = os.path.join(folder, file)
        _check_place(path, unnamed)  # before it is walked through: a link may lead to the root of all
        parts = [path] if os.path.isfile(path) else []
        for parent, folders, files in regular_file.walk(path) if os.path.isdir(path) else ():
            folders[:] = sorted(filter(unseen.is_shown, folders))
            named = [inner for inner in files if os.path.splitext(inner)[1] in ("", ".yml", ".yaml", ".json")]
            parts += [os.path.join(parent, inner) for inner in sorted(filter(unseen.is_shown, named))]
        if len(parts) > _MOST_FILES:
            message = f"it holds more than {_MOST_FILES} files"
            raise DefinitionError([Diagnostic(Location(path), message, code=Code.TOO_LARGE)])
        for part in parts:
            found.update(_variables_file(unseen.shown(part, os.path.dirname(folder)), tree, unnamed))
    return found


def _variables_file(path: str, tree: HostTree, unnamed: str) -> Variables:
    try:
        _check_place(path, unnamed)
        unseen.check(text := loader.read_text(path), path)
        unseen.check_keys(root := None if text.startswith("$ANSIBLE_VAULT;") else loader.parse(text, path))
    except DefinitionError as error:
        tree.findings.extend(error.problems)
        return {}
    if root is not None and not isinstance(root, Map):
        tree.findings.add(root, f"a file of variables is a map, not {nodes.kind(root)}", code=Code.INVENTORY)
    return variables_of(root) if isinstance(root, Map) else {}


def _scopes(tree: HostTree) -> list[Variables]:
    holders: list[Group | HostEntry] = [*tree.groups.values(), *tree.hosts.values()]
    return [scope for holder in holders for scope in (holder.variables, holder.from_files) if scope]
