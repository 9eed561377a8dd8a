"""policy.yml -> LabPolicy: what a lab allows at all, whatever flags a user gives.

Takes a path and the kinds of permission that there are; gives a value, or every problem of the file. Touches files,
for reading.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection, Mapping
from types import MappingProxyType

import msgspec

from srprov.believed import is_out_of_reach
from srprov.codes import Code
from srprov.definitions import schema
from srprov.definitions.values import scalars, text
from srprov.errors import DefinitionError, Diagnostic, Location, did_you_mean
from srprov.whose import others_may_write
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.fields import size_in_bytes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar

_LEAST = {"memory": 6 << 20, "cpus": 0.01, "pids": 1}
"""What is less would be rounded to nothing, which is no limit."""


class Limit(msgspec.Struct, frozen=True, kw_only=True):
    """How much of something a container gets."""

    default: float = 0
    """For a container that asks for nothing; 0: the most there is."""
    most: float = 0
    """0: no limit."""
    line: int = 1


class LabPolicy(msgspec.Struct, frozen=True, kw_only=True):
    """One policy file; what it does not speak of it leaves open."""

    file: str
    kinds: Mapping[str, frozenset[str]] | None = None
    """Group of the inventory -> kinds of permission that its robots may be asked for; None: all."""
    kinds_line: int = 1
    limits: Mapping[str, Limit] = msgspec.field(default_factory=lambda: MappingProxyType({}))
    """By `memory` (bytes), `cpus` and `pids`."""
    registries: tuple[str, ...] | None = None
    """Registries, or folders of one, that images may come from; None: any."""
    registries_line: int = 1

    def kinds_of(self, groups: Collection[str]) -> frozenset[str] | None:
        """Return what a robot in these groups may be asked for; None: anything."""
        if self.kinds is None:
            return None
        return frozenset().union(*(some for group, some in self.kinds.items() if group in groups or group == "all"))


def load(path: str, kinds: Collection[str]) -> LabPolicy | None:
    """Read one policy; None where there is no file.

    Raises:
        DefinitionError: It cannot be read, others could write it, or something in it is wrong.
    """
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise DefinitionError(
            [Diagnostic(Location(path), f"cannot be read: {error.strerror}", code=Code.UNREADABLE)]
        ) from None
    if others_may_write(path, status) or not is_out_of_reach(path):
        message = "a policy that others can write is none"
        hint = f"it must be yours or root's: chown, and chmod go-w {shlex.quote(str(path))}"
        raise DefinitionError([Diagnostic(Location(path), message, hint=hint, code=Code.WRONG_TYPE)])
    root = loader.read(path)
    findings = Findings()
    if not isinstance(root, Map):
        raise DefinitionError(
            [Diagnostic(Location(path), "a policy is a map", hint="begin with policy: 1", code=Code.WRONG_TYPE)]
        )
    schema.check(root, "policy", findings)
    schema.check_tags(root, findings, frozenset())
    made = None if findings.problems else _policy(path, root, kinds, findings)
    if made is None or findings.problems:
        raise DefinitionError(findings.problems)
    return made


def _policy(path: str, root: Map, kinds: Collection[str], findings: Findings) -> LabPolicy:
    allow, limits, registries = (root.entries.get(key) for key in ("allow", "limits", "registries"))
    return LabPolicy(
        file=path,
        kinds=_kinds(allow, kinds, findings) if isinstance(allow, Map) else None,
        kinds_line=root.keys["allow"].line if allow else 1,
        limits={name: _limit(root, name, findings) for name in (limits.entries if isinstance(limits, Map) else ())},
        registries=tuple(text(item).strip("/") for item in scalars(registries)) if registries else None,
        registries_line=root.keys["registries"].line if registries else 1,
    )


def _kinds(allow: Map, kinds: Collection[str], findings: Findings) -> dict[str, frozenset[str]]:
    found = {}
    for group, some in allow.entries.items():
        for item in scalars(some):
            if item.text not in (*kinds, "all"):
                hint = did_you_mean(item.text, kinds) or f"known: {', '.join(kinds)}, all"
                findings.add(
                    item,
                    f"there is no kind '{item.text[:60]}' of permission",
                    ("allow", group),
                    hint,
                    code=Code.WRONG_VALUE,
                )
        named = {item.text for item in scalars(some)}
        found[group] = frozenset(kinds) if "all" in named else frozenset(named)
    return found


def _limit(root: Map, name: str, findings: Findings) -> Limit:
    limits = root.entries["limits"]
    assert isinstance(limits, Map)
    given = limits.entries[name]
    ends = {key: _number(name, node, findings) for key, node in given.entries.items()} if isinstance(given, Map) else {}
    default, most = ends.get("default", 0.0), ends.get("max", 0.0)
    if most and default > most:
        findings.add(given, "the default is more than the maximum", ("limits", name), code=Code.WRONG_VALUE)
    return Limit(default=default, most=most, line=limits.keys[name].line)


def _number(name: str, node: Node, findings: Findings) -> float:
    assert isinstance(node, Scalar)
    try:
        number = size_in_bytes(node.text) if name == "memory" else nodes.as_number(node) or 0.0
    except ValueError as error:
        findings.add(node, str(error), ("limits", name), code=Code.WRONG_VALUE)
        return 0.0
    if number < _LEAST[name]:
        findings.add(node, f"'{node.text[:40]}' is less than an engine takes", ("limits", name), code=Code.WRONG_VALUE)
    return number
