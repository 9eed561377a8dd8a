"""An inventory that is a program -> hosts, groups and variables, from the JSON that it prints.

Takes the program's path; adds to the `HostTree`. Runs it with `--list` (and `--host NAME` for one that gives no
`_meta`), with a deadline for all of it; nothing of a program that overruns is left running.
"""

from __future__ import annotations

import os
import subprocess
import time

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions import unseen
from srprov.definitions.groups import HostTree, variables_of
from srprov.definitions.program import read_both, stop
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.untrusted import MAX_JSON_CHARACTERS, parse_json
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq, Source

DEADLINE_S = 30.0
_FIRST_LINE = 4096


def is_program(path: str) -> bool:
    """Return whether a file is an inventory to be run: executable, and a script or a binary."""
    try:
        return os.access(path, os.X_OK) and regular_file.beginning(path, 2) in (b"#!", b"\x7fE")
    except (OSError, ValueError):
        return False


def read(path: str, tree: HostTree, deadline_s: float = DEADLINE_S) -> None:
    """Run the program and add everything that it says.

    Raises:
        DefinitionError: It shows itself as data; it fails, takes too long, or prints no JSON of an inventory's shape.
    """
    unseen.check_program(path, regular_file.beginning(path, _FIRST_LINE).split(b"\n")[0].decode(errors="replace"))
    end = time.monotonic() + deadline_s
    root = _answer(path, ["--list"], end)
    meta = root.entries.get("_meta")
    host_variables = meta.entries.get("hostvars") if isinstance(meta, Map) else None
    for name, group in root.entries.items():
        if name != "_meta":
            _group(name, group, tree)
    for name in sorted(tree.hosts) if host_variables is None else []:
        tree.hosts[name].variables.update(variables_of(_answer(path, ["--host", name], end)))
    for name, variables in host_variables.entries.items() if isinstance(host_variables, Map) else ():
        if name in tree.hosts and isinstance(variables, Map):
            tree.hosts[name].variables.update(variables_of(variables))


def _group(name: str, node: Node, tree: HostTree) -> None:
    group = tree.group(name)
    entries = node.entries if isinstance(node, Map) else {"hosts": node}
    hosts, children, variables = (entries.get(key) for key in ("hosts", "children", "vars"))
    for host in hosts.items if isinstance(hosts, Seq) else ():
        if isinstance(host, Scalar):
            tree.add_hosts(host, name)
    for child in children.items if isinstance(children, Seq) else ():
        if isinstance(child, Scalar):
            tree.group(child.text)
            group.children[child.text] = child
    if isinstance(variables, Map):
        group.variables.update(variables_of(variables))


def _answer(path: str, arguments: list[str], end: float) -> Map:
    """Run the program once and return the JSON object that it prints."""
    command = [os.path.abspath(path), *arguments]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
    except OSError as error:
        raise _failed(path, f"cannot be run: {error.strerror}") from None
    try:
        out, err = read_both(process, end, MAX_JSON_CHARACTERS + 1)
        if len(out) > MAX_JSON_CHARACTERS:
            raise _failed(path, f"'{' '.join(arguments)}' printed more than {MAX_JSON_CHARACTERS >> 20} MiB")
        process.wait(max(end - time.monotonic(), 0.01))
    except (TimeoutError, subprocess.TimeoutExpired):
        raise _failed(path, f"'{' '.join(arguments)}' gave no answer in time", "the deadline is 30 seconds") from None
    finally:
        stop(process)
    if process.returncode != 0:
        last = (err.decode("utf-8", "replace").strip().splitlines() or [""])[-1]
        raise _failed(path, f"'{' '.join(arguments)}' ended with {process.returncode}: {last[:200]}")
    try:
        root = nodes.from_json(parse_json(out.decode("utf-8-sig")), Source(path))
    except ValueError as error:
        raise _failed(path, f"'{' '.join(arguments)}' printed no JSON: {str(error)[:200]}") from None
    if not isinstance(root, Map):
        raise _failed(path, f"'{' '.join(arguments)}' printed {nodes.kind(root)}, not a map")
    return root


def _failed(path: str, message: str, hint: str = "") -> DefinitionError:
    return DefinitionError([Diagnostic(Location(path), message, "", "", hint, code=Code.INVENTORY_PROGRAM)])
