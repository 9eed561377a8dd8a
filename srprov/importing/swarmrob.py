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
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from srprov.codes import Code
from srprov.definitions import dockerfile
from srprov.errors import DefinitionError, Diagnostic, did_you_mean
from srprov.importing.normal import Normal, Refused
from srprov.importing.position import Path, Position
from srprov.importing.swarmrob_service import COMPOSE, Reading, service
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.nodes import Findings, Map, Scalar

_TOP = ("version", "services")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)
_LONGEST_NAME = 255
_WORD = re.compile(r"[\w.-]+")
_PROJECT = re.compile(r"[A-Za-z0-9-]+")
_END = re.compile(r"_1(?![\w-])")


class Found(msgspec.Struct, frozen=True):
    """What the files say."""

    normal: Normal
    passed_over: tuple[tuple[Path, str], ...]
    """Keys that SwarmRob does not read, and what to say of each."""
    folders: tuple[str, ...]
    """Real paths of the folders of the files."""


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
            [
                Diagnostic(
                    place,
                    "SwarmRob runs one definition at a time",
                    hint="name one, and its Dockerfiles",
                    code=Code.SWARMROB,
                )
            ]
        )
    try:
        return _read(definitions[0], recipes, settings or {}, name)
    except Refused:
        raise
    except DefinitionError as error:
        raise Refused(error.problems) from None


def _read(file: str, recipes: Sequence[str], settings: Mapping[str, str], name: str) -> Found:
    root = loader.read(file)
    reading = Reading(Findings(), settings)
    if not isinstance(root, Map):
        what = "the file is empty" if root is None else f"a definition is a map, not {nodes.kind(root)}"
        raise Refused(
            [Diagnostic(Position(file), what, hint="SwarmRob's have 'version' and 'services'", code=Code.SWARMROB)]
        )
    reading.at((), root)
    services = root.entries.get("services")
    for key in root.entries:
        if key not in _TOP:
            hint = did_you_mean(key, _TOP) or COMPOSE
            reading.findings.add(
                root.keys[key], f"SwarmRob ends at the key '{key[:60]}'", (key,), hint, code=Code.SWARMROB
            )
    if not isinstance(services, Map) or not services.entries:
        place = services if services is not None else root
        reading.findings.add(
            place, "has no services", ("services",), "services: {name: {image: …}}", code=Code.SWARMROB
        )
    read = _services(services, reading) if isinstance(services, Map) else {}
    _built(recipes, read, reading)
    if reading.findings.problems:
        raise Refused(reading.findings.problems)
    folder = os.path.dirname(os.path.realpath(file))
    _name_those_in_use(read)
    document = {"name": name or os.path.basename(folder), "services": read}
    normal = Normal(document, reading.positions, tuple(reading.variables), tuple(reading.notes))
    folders = dict.fromkeys((folder, *(os.path.dirname(os.path.realpath(one)) for one in recipes)))
    return Found(normal, tuple(reading.passed_over), tuple(folders))


def _services(given: Map, reading: Reading) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for name, entry in given.entries.items():
        at: Path = ("services", name)
        reading.at(at, given.keys[name])
        image = entry.entries.get("image") if isinstance(entry, Map) else None
        if not _NAME.fullmatch(name):
            reading.findings.add(given.keys[name], f"'{name[:60]}' is no service's name", at, code=Code.SWARMROB)
        elif not isinstance(entry, Map):
            reading.findings.add(
                entry, f"a service is a map, not {nodes.kind(entry)}", at, "image: NAME", code=Code.SWARMROB
            )
        elif not isinstance(image, Scalar) or not image.text or nodes.is_null(image):
            reading.findings.add(
                image or given.keys[name], f"'{name[:60]}' has no image", (*at, "image"), code=Code.SWARMROB
            )
        else:
            found[name] = service(entry, set(given.entries), reading, at)
    return found


def _built(recipes: Sequence[str], services: dict[str, dict[str, Any]], reading: Reading) -> None:
    """Have the services built whose image has a Dockerfile's name."""
    for path in recipes:
        # what it is called is the user's word; what lies where it leads, a stranger's
        called, named = os.path.split(os.path.abspath(path))
        suffix = named.removeprefix("Dockerfile").removesuffix("Dockerfile").removesuffix(".dockerfile").strip(".-")
        name = suffix or os.path.basename(called)
        folder, file = os.path.split(os.path.realpath(path))
        text = loader.read_text(path, most=dockerfile.MAX_BYTES)
        reading.findings.extend(dockerfile.check(text, path))
        using = [one for one in services.values() if one.get("image", "").rpartition("/")[2].partition(":")[0] == name]
        if not using:
            place = Diagnostic(
                Position(path), f"no service has the image '{name[:60]}'", hint="leave the file out", code=Code.SWARMROB
            )
            reading.findings.extend([place])
        for one in using:
            one["build"] = {"context": folder, "dockerfile": file}
            del one["image"]


def _name_those_in_use(services: Mapping[str, dict[str, Any]]) -> None:
    """Give services the names that values use for them: `NAME_1`, or with the project's before it, as containers had.

    Each value is looked through once, for all names.
    """
    of_others: dict[str, str] = {}
    of_its_own: dict[str, str] = {}
    longest = min(_LONGEST_NAME, max(map(len, services), default=0))
    for each, one in services.items():
        for value in (one.get("environment") or {}).values():
            for name, used in _names_in(value or "", longest):
                if name in services:
                    (of_its_own if name == each else of_others).setdefault(name, used)
    for each, one in services.items():
        if used := of_others.get(each) or of_its_own.get(each, ""):
            one["hostname"] = used


def _names_in(value: str, longest: int) -> Iterator[tuple[str, str]]:
    """Yield what may be a service's name, at most so long, in a value, and all of the word that it is in."""
    for word in _WORD.finditer(value) if "_1" in value else ():
        project, line, _ = word[0].partition("_")
        has_project = line and len(project) <= _LONGEST_NAME and _PROJECT.fullmatch(project)
        begin = len(project) + 1 if has_project else 0
        for end in _END.finditer(word[0], 0, begin + longest + len("_1.")):
            name, used = word[0][: end.start()], word[0][: end.start() + len("_1")]
            if begin and begin < len(name):
                yield name[begin:], used
            yield name, used
