"""One service of a definition of SwarmRob: what SwarmRob reads of it, as Compose would print it. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from shlex import quote
from typing import Any

from srprov.codes import Code
from srprov.errors import did_you_mean
from srprov.importing.normal import Note, Variable
from srprov.importing.position import Path, Position
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq

COMPOSE = "srprov import compose reads Compose files"
_READ = ("image", "environment", "depends_on", "devices", "volumes")
_PLACEMENT: Path = ("deploy", "placement", "constraints")
_VARIABLE = re.compile(r"\$(?:(?P<plain>\w+)|\{(?P<braced>[^}]*)\})", re.ASCII)
_PLAIN = re.compile(r"\$(?P<plain>\w+)(?P<braced>)", re.ASCII)
"""Of a text without `}`: the end of each `${` would be looked for up to the end of the text."""


@dataclass
class Reading:
    """What is found on the way through one definition."""

    findings: Findings
    settings: Mapping[str, str]
    positions: dict[Path, Position] = field(default_factory=dict)
    variables: list[Variable] = field(default_factory=list)
    passed_over: list[tuple[Path, str]] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)

    def at(self, path: Path, node: Node) -> None:
        """Note where a value is written."""
        self.positions[path] = nodes.location(node)


def service(entry: Map, known: set[str], reading: Reading, at: Path) -> dict[str, Any]:
    """Return a service; what is wrong is added to the findings."""
    found: dict[str, Any] = {}
    for key, value in entry.entries.items():
        path = (*at, key)
        reading.at(path, entry.keys[key])
        if key == "image":
            assert isinstance(value, Scalar)
            found[key] = value.text
        elif key in _READ and not isinstance(value, Seq):
            reading.findings.add(
                value, f"SwarmRob reads a list here, not {nodes.kind(value)}", path, COMPOSE, code=Code.SWARMROB
            )
        elif key == "environment":
            found[key] = _environment(value, reading, path)
        elif key == "depends_on":
            waits = [one for one in _words(value, reading, path) if _is_known(one, known, reading, path)]
            found[key] = {one.text: {"condition": "service_started", "required": True} for one in waits}
        elif key in ("devices", "volumes"):
            pairs = [pair for one in _words(value, reading, path) if (pair := _pair(one, reading, path))]
            found[key] = [_device(*pair) if key == "devices" else _volume(*pair) for pair in pairs]
        elif key == "deploy":
            found.update(_deploy(value, reading, path))
        else:
            reading.passed_over.append((path, f"SwarmRob passes over '{key[:60]}'"))
    return found


def _words(node: Node, reading: Reading, path: Path) -> list[Scalar]:
    """Return a list's texts, and note what is none."""
    found = []
    for index, one in enumerate(node.items if isinstance(node, Seq) else ()):
        reading.at((*path, index), one)
        if isinstance(one, Scalar) and not nodes.is_null(one):
            found.append(one)
        else:
            reading.findings.add(one, f"expected text, not {nodes.kind(one)}", (*path, index), code=Code.SWARMROB)
    return found


def _is_known(one: Scalar, known: set[str], reading: Reading, path: Path) -> bool:
    if one.text not in known:
        hint = did_you_mean(one.text, known) or "SwarmRob would wait for ever"
        reading.findings.add(one, f"there is no service '{one.text[:60]}'", path, hint, code=Code.SWARMROB)
    return one.text in known


def _pair(one: Scalar, reading: Reading, path: Path) -> tuple[str, str] | None:
    parts = one.text.split(":")
    if len(parts) != 2 or not all(parts) or not parts[1].startswith("/"):
        reading.findings.add(
            one, f"SwarmRob reads 'source:target' here, not '{one.text[:60]}'", path, COMPOSE, code=Code.SWARMROB
        )
        return None
    if not parts[0].startswith("/") and (path[-1] == "devices" or "/" in parts[0]):
        hint = "write an absolute path of the robot"
        reading.findings.add(one, f"'{parts[0][:60]}' is no path that a worker has", path, hint, code=Code.SWARMROB)
        return None
    return parts[0], parts[1]


def _device(source: str, target: str) -> dict[str, str]:
    return {"source": source, "target": target, "permissions": "rwm"}


def _volume(source: str, target: str) -> dict[str, str]:
    return {"type": "bind" if source.startswith("/") else "volume", "source": source, "target": target}


def _environment(node: Node, reading: Reading, path: Path) -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for one in _words(node, reading, path):
        name, given, value = one.text.partition("=")
        if not given or not name:
            hint = "write NAME=value"
            reading.findings.add(
                one, f"SwarmRob reads NAME=value here, not '{name[:60]}'", path, hint, code=Code.SWARMROB
            )
            continue
        reading.at((*path, name), one)
        if not value:
            reading.passed_over.append(((*path, name), f"SwarmRob leaves out '{name[:60]}', which is empty"))
        else:
            found[name] = _put_in(value, one, reading, path)
    return found


def _put_in(value: str, node: Scalar, reading: Reading, path: Path) -> str | None:
    """Return a value with its variables put in; None: it is one variable alone, which has no value here."""
    lost: list[str] = []

    def replaced(match: re.Match[str]) -> str:
        name = match["plain"] or match["braced"]
        known = name in reading.settings
        source = "--set" if known else "unset"
        reading.variables.append(Variable(name, source, reading.settings.get(name, ""), nodes.location(node)))
        if not known:
            lost.append(name)
        return reading.settings.get(name, "")

    end = value.rfind("}") + 1
    result = _VARIABLE.sub(replaced, value[:end]) + _PLAIN.sub(replaced, value[end:])
    if lost and _VARIABLE.fullmatch(value):
        return None
    for name in lost:
        hint = f"--set {quote(name[:60])}=VALUE: the environment is not looked at"
        reading.findings.add(
            node, f"'{name[:60]}' is a variable of the master's environment", path, hint, code=Code.SWARMROB
        )
    return result


def _deploy(node: Node, reading: Reading, path: Path) -> dict[str, Any]:
    """Return what SwarmRob parses and never uses, where it says on which robot a service should run."""
    place = nodes.find(node, _PLACEMENT[1:])
    constraints = [one.text for one in place.items if isinstance(one, Scalar)] if isinstance(place, Seq) else []
    if not constraints:
        reading.passed_over.append((path, "SwarmRob passes over 'deploy'"))
        return {}
    reading.at((*path, *_PLACEMENT[1:]), place)
    words = "SwarmRob parses this and places services elsewhere; here it counts"
    reading.notes.append(Note(nodes.location(place), words))
    return {"deploy": {"placement": {"constraints": [one for one in constraints]}}}
