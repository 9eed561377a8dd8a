"""SwarmRob's own experiment definitions and Dockerfiles -> the project that they are, as for Compose files.

Takes paths; gives a `Normal`, and what SwarmRob itself passes over. Reads the files. Its definitions look like Compose
files of version 3 and mean less: it reads `image`, `environment`, `depends_on`, `devices` and `volumes` of services, in
one form each, puts the master's variables into values, and passes over everything else. A container definition is a
Dockerfile, which it never builds; here the services whose image has the name of a Dockerfile's folder are built by it.

Source: what SwarmRob 0.1.1 does with its files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from srprov.definitions import dockerfile
from srprov.errors import DefinitionError, Diagnostic, did_you_mean
from srprov.importing.normal import Normal, Note, Refused, Variable
from srprov.importing.position import Path, Position
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Node, Scalar, Seq

_TOP = ("version", "services")
_READ = ("image", "environment", "depends_on", "devices", "volumes")
_PLACEMENT: Path = ("deploy", "placement", "constraints")
_VARIABLE = re.compile(r"\$(?:(?P<plain>\w+)|\{(?P<braced>[^}]*)\})", re.ASCII)
_COMPOSE = "srprov import compose reads Compose files"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Found:
    """What the files say."""

    normal: Normal
    passed_over: tuple[tuple[Path, str], ...]
    """Keys that SwarmRob does not read, and what to say of each."""
    folders: tuple[str, ...]
    """Real paths of the folders of the files."""


@dataclass
class _Reading:
    findings: Findings
    settings: Mapping[str, str]
    positions: dict[Path, Position] = field(default_factory=dict)
    variables: list[Variable] = field(default_factory=list)
    passed_over: list[tuple[Path, str]] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)

    def at(self, path: Path, node: Node) -> None:
        self.positions[path] = nodes.location(node)


def read(files: Sequence[str], settings: Mapping[str, str] | None = None, name: str = "") -> Found:
    """Read one definition, and the Dockerfiles that belong to it.

    Raises:
        Refused: With everything that is wrong, or that SwarmRob itself cannot read.
    """
    recipes = [one for one in files if dockerfile.is_dockerfile(one)]
    definitions = [one for one in files if one not in recipes]
    if len(definitions) != 1:
        place = Position(definitions[1] if definitions else files[0])
        raise Refused(
            [Diagnostic(place, "SwarmRob runs one definition at a time", hint="name one, and its Dockerfiles")]
        )
    try:
        return _read(definitions[0], recipes, settings or {}, name)
    except Refused:
        raise
    except DefinitionError as error:
        raise Refused(error.problems) from None


def _read(file: str, recipes: Sequence[str], settings: Mapping[str, str], name: str) -> Found:
    root = loader.read(file)
    reading = _Reading(Findings(), settings)
    if not isinstance(root, Map):
        what = "the file is empty" if root is None else f"a definition is a map, not {nodes.kind(root)}"
        raise Refused([Diagnostic(Position(file), what, hint="SwarmRob's have 'version' and 'services'")])
    reading.at((), root)
    services = root.entries.get("services")
    for key in root.entries:
        if key not in _TOP:
            hint = did_you_mean(key, _TOP) or _COMPOSE
            reading.findings.add(root.keys[key], f"SwarmRob ends at the key '{key[:60]}'", (key,), hint)
    if not isinstance(services, Map) or not services.entries:
        place = services if services is not None else root
        reading.findings.add(place, "has no services", ("services",), "services: {name: {image: …}}")
    read = _services(services, reading) if isinstance(services, Map) else {}
    _built(recipes, read, reading)
    if reading.findings.problems:
        raise Refused(reading.findings.problems)
    folder = os.path.dirname(os.path.realpath(file))
    for service, one in read.items():
        _name_in_use(service, one, read)
    document = {"name": name or os.path.basename(folder), "services": read}
    normal = Normal(document, reading.positions, tuple(reading.variables), tuple(reading.notes))
    folders = dict.fromkeys((folder, *(os.path.dirname(os.path.realpath(one)) for one in recipes)))
    return Found(normal, tuple(reading.passed_over), tuple(folders))


def _services(given: Map, reading: _Reading) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for name, entry in given.entries.items():
        at: Path = ("services", name)
        reading.at(at, given.keys[name])
        image = entry.entries.get("image") if isinstance(entry, Map) else None
        if not _NAME.fullmatch(name):
            reading.findings.add(given.keys[name], f"'{name[:60]}' is no service's name", at)
        elif not isinstance(entry, Map):
            reading.findings.add(entry, f"a service is a map, not {nodes.kind(entry)}", at, "image: NAME")
        elif not isinstance(image, Scalar) or not image.text or nodes.is_null(image):
            reading.findings.add(image or given.keys[name], f"'{name[:60]}' has no image", (*at, "image"))
        else:
            found[name] = _service(entry, set(given.entries), reading, at)
    return found


def _service(entry: Map, known: set[str], reading: _Reading, at: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in entry.entries.items():
        path = (*at, key)
        reading.at(path, entry.keys[key])
        if key == "image":
            assert isinstance(value, Scalar)
            found[key] = value.text
        elif key in _READ and not isinstance(value, Seq):
            reading.findings.add(value, f"SwarmRob reads a list here, not {nodes.kind(value)}", path, _COMPOSE)
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


def _words(node: Node, reading: _Reading, path: Path) -> list[Scalar]:
    """Return a list's texts, and note what is none."""
    found = []
    for index, one in enumerate(node.items if isinstance(node, Seq) else ()):
        reading.at((*path, index), one)
        if isinstance(one, Scalar) and not nodes.is_null(one):
            found.append(one)
        else:
            reading.findings.add(one, f"expected text, not {nodes.kind(one)}", (*path, index))
    return found


def _is_known(one: Scalar, known: set[str], reading: _Reading, path: Path) -> bool:
    if one.text not in known:
        hint = did_you_mean(one.text, known) or "SwarmRob would wait for ever"
        reading.findings.add(one, f"there is no service '{one.text[:60]}'", path, hint)
    return one.text in known


def _pair(one: Scalar, reading: _Reading, path: Path) -> tuple[str, str] | None:
    parts = one.text.split(":")
    if len(parts) != 2 or not all(parts) or not parts[1].startswith("/"):
        reading.findings.add(one, f"SwarmRob reads 'source:target' here, not '{one.text[:60]}'", path, _COMPOSE)
        return None
    if not parts[0].startswith("/") and (path[-1] == "devices" or "/" in parts[0]):
        hint = "write an absolute path of the robot"
        reading.findings.add(one, f"'{parts[0][:60]}' is no path that a worker has", path, hint)
        return None
    return parts[0], parts[1]


def _device(source: str, target: str) -> dict[str, str]:
    return {"source": source, "target": target, "permissions": "rwm"}


def _volume(source: str, target: str) -> dict[str, str]:
    return {"type": "bind" if source.startswith("/") else "volume", "source": source, "target": target}


def _environment(node: Node, reading: _Reading, path: Path) -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for one in _words(node, reading, path):
        name, given, value = one.text.partition("=")
        if not given or not name:
            hint = "write NAME=value"
            reading.findings.add(one, f"SwarmRob reads NAME=value here, not '{name[:60]}'", path, hint)
            continue
        reading.at((*path, name), one)
        if not value:
            reading.passed_over.append(((*path, name), f"SwarmRob leaves out '{name[:60]}', which is empty"))
        else:
            found[name] = _put_in(value, one, reading, path)
    return found


def _put_in(value: str, node: Scalar, reading: _Reading, path: Path) -> str | None:
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

    result = _VARIABLE.sub(replaced, value)
    if lost and _VARIABLE.fullmatch(value):
        return None
    for name in lost:
        hint = f"--set {name[:60]}=VALUE: the environment is not looked at"
        reading.findings.add(node, f"'{name[:60]}' is a variable of the master's environment", path, hint)
    return result


def _deploy(node: Node, reading: _Reading, path: Path) -> dict[str, Any]:
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


def _built(recipes: Sequence[str], services: dict[str, dict[str, Any]], reading: _Reading) -> None:
    """Have the services built whose image has a Dockerfile's name."""
    for path in recipes:
        folder, file = os.path.split(os.path.realpath(path))
        suffix = file.removeprefix("Dockerfile").removesuffix("Dockerfile").removesuffix(".dockerfile").strip(".-")
        name = suffix or os.path.basename(folder)
        text = loader.read_text(path, most=dockerfile.MAX_BYTES)
        reading.findings.extend(dockerfile.check(text, path))
        using = [one for one in services.values() if one["image"].rpartition("/")[2].partition(":")[0] == name]
        if not using:
            place = Diagnostic(Position(path), f"no service has the image '{name[:60]}'", hint="leave the file out")
            reading.findings.extend([place])
        for one in using:
            one["build"] = {"context": folder, "dockerfile": file}
            del one["image"]


def _name_in_use(name: str, one: dict[str, Any], services: Mapping[str, Mapping[str, Any]]) -> None:
    """Give a service the name that values use for it: `NAME_1`, or with the project's before it, as containers had."""
    form = re.compile(rf"(?<![\w.-])(?:[A-Za-z0-9-]+_)?{re.escape(name)}_1(?![\w-])")
    others = (other for key, other in services.items() if key != name)
    for each in (*others, one):
        for value in (each.get("environment") or {}).values():
            if value and (match := form.search(value)):
                one["hostname"] = match[0]
                return
