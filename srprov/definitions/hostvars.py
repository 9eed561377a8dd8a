"""A host's variables -> Host: the few that srprov reads.

Takes the effective variables of one host; gives a `Host`. Touches nothing. All other variables pass unseen, whatever
they hold; a Jinja2 template or a vault value is a problem only in a variable that is read. Two templates are so
common that they are understood as plain names: `{{ inventory_hostname }}` and `{{ inventory_dir }}`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

from srprov.codes import Code
from srprov.definitions import host_values, sshargs
from srprov.definitions.groups import HostEntry, Variables
from srprov.definitions.host_values import NAMES, Values
from srprov.definitions.model import Host
from srprov.errors import visible
from srprov.secret import Secret
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Node, Scalar, Seq

_T = TypeVar("_T")
_SSH = {"ssh", "smart", "paramiko", "paramiko_ssh", "ansible.builtin.ssh", "ansible.builtin.paramiko_ssh"}
_LOCAL = {"local", "ansible.builtin.local"}
_ONE_WORD = re.compile(r"[\w/.,:@+-]*")
"""Of the path of a folder: what no shell, and not ssh, takes for anything else."""
_BECOME_PASSWORD = ("ansible_become_password", "ansible_become_pass", "ansible_sudo_pass")
_PASSWORD = ("ansible_password", "ansible_ssh_pass", "ansible_ssh_password")
_ARGUMENTS = ("ansible_ssh_args", "ansible_ssh_common_args", "ansible_ssh_extra_args")
READ = frozenset((
    *_BECOME_PASSWORD, *_ARGUMENTS, "ansible_become", "ansible_connection",
    "ansible_ssh_private_key_file", "ansible_private_key_file",
    "ansible_host", "ansible_ssh_host", "ansible_port", "ansible_ssh_port", "ansible_user", "ansible_ssh_user",
    *_PASSWORD, "srprov_tags", "srprov_slots", "srprov_underlay", "srprov_devices", "srprov_bandwidth_mbit",
    "srprov_pid", "srprov_site",
))  # fmt: skip
"""Every variable that `host` reads; a test holds it to that."""


def host(entry: HostEntry, variables: Variables, groups: tuple[str, ...], values: Values, findings: Findings) -> Host:
    """Return one host; what is wrong with a variable is added to the findings."""
    name, place = entry.name, entry.place
    folder = values.once(place.source, lambda: place.source.folder)
    reader = _VariableReader(name, variables, folder, values, findings)
    no_options: list[tuple[str, str]] = []
    options = tuple(option for key in _ARGUMENTS for option in reader.read(key, sshargs.parse, no_options))
    identity = reader.text("ansible_ssh_private_key_file", "ansible_private_key_file")
    return Host(
        name=name,
        address=reader.text("ansible_host", "ansible_ssh_host") or name,
        port=reader.read("ansible_port", _port, None) or reader.read("ansible_ssh_port", _port, None),
        user=reader.text("ansible_user", "ansible_ssh_user"),
        identity_file=reader.file(identity) if identity else None,
        password=reader.secret(*_PASSWORD),
        become=reader.read("ansible_become", _flag, False),
        become_password=reader.secret(*_BECOME_PASSWORD, hidden_is_none=True),
        connection=reader.read("ansible_connection", _connection, "ssh"),
        ssh_options=options,
        tags=reader.words("srprov_tags"),
        slots=reader.node("srprov_slots", nodes.as_int),
        underlay=reader.text("srprov_underlay"),
        devices=reader.words("srprov_devices"),
        bandwidth_mbit=reader.node("srprov_bandwidth_mbit", nodes.as_number),
        pid=reader.text("srprov_pid") or "",
        site=reader.text("srprov_site") or "",
        groups=groups,
        location=nodes.location(place),
    )


def needs_trust(one: Host) -> bool:
    """Return whether a host has what only an inventory that the user named may say: it runs, or opens, something.

    At a site other keys of his open other robots: which site is asked is for him to say.
    A password is told the address that stands beside it, and of two inventories each may say one of these.
    """
    passwords = one.password is not None or one.become_password is not None
    return passwords or bool(one.ssh_options or one.identity_file or one.site) or one.connection == "local"


def own_files(scopes: Iterable[Variables], hosts: Iterable[Host]) -> tuple[str, ...]:
    """Return the real paths of the files in which passwords of robots stand, and of the keys that open them."""
    passwords = (*_PASSWORD, *_BECOME_PASSWORD)
    found = {one[key][1].source.file for one in scopes for key in passwords if key in one}
    found |= {host.identity_file for host in hosts if host.identity_file}
    return tuple(sorted({os.path.realpath(path) for path in found if "\0" not in path}))


class _VariableReader:
    """Reads single variables of one host."""

    def __init__(self, name: str, variables: Variables, folder: str, values: Values, findings: Findings) -> None:
        self.variables = variables
        self.values = values
        self.folder = folder
        self.findings = findings
        self.names = {
            "inventory_hostname": name,
            "inventory_hostname_short": name.split(".", maxsplit=1)[0],
            "inventory_dir": folder,
        }

    def visible(self, key: str) -> Node | None:
        """Return a variable's value; a template or a vault value is a problem, and none is given."""
        found = self.variables.get(key)
        if found is None:
            return None
        self.values.count(key, found[1], self.names, self.findings)
        return None if self._hidden(key, found[1]) else found[1]

    def node(self, key: str, reader: Callable[[Node], _T | None]) -> _T | None:
        """Read a variable whose shape the schema checks."""
        found = self.visible(key)
        return None if found is None else reader(found)

    def text(self, *keys: str) -> str | None:
        """Return the first of some variables that is set, as text."""
        for key in keys:
            found = self.visible(key)
            if isinstance(found, Scalar) and not nodes.is_null(found):
                named = self._named(found)
                if key in _ARGUMENTS and named != found.text and not _ONE_WORD.fullmatch(self.folder):
                    # nobody who reads it sees that name: it would be further options, or be run by a shell
                    message = f"its folder, {visible(self.folder)[:80]}, is more than one word of ssh's arguments"
                    hint = f"give '{key}' the whole path, in quotes, or the folder another name"
                    self.findings.add(found, message, (key,), hint, code=Code.HOST_VARIABLE)
                    return None
                return named
            if found is not None and not isinstance(found, Scalar):
                self.findings.add(found, f"'{key}' is text, not {nodes.kind(found)}", (key,), code=Code.HOST_VARIABLE)
        return None

    def read(self, key: str, reader: Callable[[str], _T], default: _T) -> _T:
        """Read a variable's text by a function whose ValueError tells what is wrong."""
        given = self.text(key)
        if given is None:
            return default
        node = self.variables[key][1]
        read = self.values.of_text(key, node, self.names, lambda: _read(given, reader))
        if isinstance(read, ValueError):
            self.findings.add(node, str(read), (key,), code=Code.HOST_VARIABLE)
            return default
        return read

    def words(self, key: str) -> tuple[str, ...]:
        """Return a list's texts, or those of one text with commas; each once, in order."""
        found = self.visible(key)
        return () if found is None else self.values.once(("words", found), lambda: _words(found))

    def secret(self, *keys: str, hidden_is_none: bool = False) -> Secret | None:
        """Return a password, wrapped at once; where a robot may do without one, a vault value is as good as none."""
        if hidden_is_none:
            keys = tuple(key for key in keys if key in self.variables and self._unknown(key) in ("", host_values.NUL))
        given = self.text(*keys)
        if given is None:
            return None
        read = self.values.once(("secret", given), lambda: _read(given, Secret))
        if isinstance(read, ValueError):
            key = next(key for key in keys if key in self.variables)
            self.findings.add(self.variables[key][1], f"'{key}' is too short: {read}", (key,), code=Code.HOST_VARIABLE)
            return None
        return read

    def file(self, path: str) -> str:
        """Return a file of the controller: `~` is the home; a relative one is looked for beside the inventory first."""
        return self.values.once(("file", path, self.folder), lambda: self._file(path))

    def _file(self, path: str) -> str:
        expanded = os.path.expanduser(path)
        beside = os.path.join(self.folder, expanded)
        return beside if not os.path.isabs(expanded) and os.path.exists(beside) else os.path.abspath(expanded)

    def _named(self, node: Scalar) -> str:
        if not self.values.names_in(node):
            return node.text
        return self.values.of_text(
            "named", node, self.names, lambda: NAMES.sub(lambda match: self.names[match[1]], node.text)
        )

    def _unknown(self, key: str) -> str:
        node = self.variables[key][1]
        return self.values.once(("unknown", node), lambda: host_values.why_unknown(node))

    def _hidden(self, key: str, node: Node) -> bool:
        what = self._unknown(key)
        if what:
            hint = host_values.HINTS[what]
            self.findings.add(node, f"'{key}' is {what}, but srprov reads it", (key,), hint, code=Code.HOST_VARIABLE)
        return bool(what)


def _read(text: str, reader: Callable[[str], _T]) -> _T | ValueError:
    """Return what a function reads of a text, or what it says is wrong."""
    try:
        return reader(text)
    except ValueError as error:
        return error


def _words(node: Node) -> tuple[str, ...]:
    items = node.items if isinstance(node, Seq) else ()
    texts = [item.text for item in items if isinstance(item, Scalar)]
    if isinstance(node, Scalar) and not nodes.is_null(node):
        texts = [word.strip() for word in node.text.split(",") if word.strip()]
    return tuple(dict.fromkeys(texts))


def _port(text: str) -> int | None:
    if not text.isascii() or not text.isdecimal() or not 1 <= int(text[:9]) <= 65535:
        raise ValueError(f"'{text[:40]}' is not a port within 1 to 65535")
    return int(text)


def _flag(text: str) -> bool:
    words: Mapping[str, bool] = {
        "yes": True,
        "true": True,
        "on": True,
        "1": True,
        "no": False,
        "false": False,
        "off": False,
        "0": False,
    }
    if text.lower() not in words:
        raise ValueError(f"'{text[:40]}' is neither true nor false")
    return words[text.lower()]


def _connection(text: str) -> str:
    if text in _SSH | _LOCAL:
        return "ssh" if text in _SSH else "local"
    raise ValueError(f"srprov reaches robots by ssh, or itself by local; not by '{text[:40]}'")
