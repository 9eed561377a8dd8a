"""`secrets` of an EDF and of its services -> where each value comes from, and which container sees it where.

Takes the root's and a service's map, whose shape the schema has checked; gives values, and problems at their lines.
No value is read here (`secretvalues.py` does that, for plan and apply only).
"""

from __future__ import annotations

import contextlib
import os
import posixpath
import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType

from msgspec.structs import replace

from srprov.codes import Code
from srprov.definitions import schema, values
from srprov.definitions.containermodel import Mount
from srprov.definitions.model import Service
from srprov.definitions.secretmodel import SecretSource, SecretUse, is_gone_by
from srprov.definitions.values import text
from srprov.errors import DefinitionError, did_you_mean
from srprov.yamldoc import loader, nodes
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.nodes import Findings, Map, Node, Path, Scalar, Seq

_FOLDER = "/run/secrets"
_MODE = "0400"
_PLACEHOLDER = re.compile(r"\$?\{\{?\s*secrets?\s*[.:\[]|\bsecret://", re.IGNORECASE)
"""`${{ secrets.x }}`, `{{ secrets.x }}`, `${secret:x}`, `secret://x`: how other tools write a secret inside text."""
_ELSEWHERE = ("environment", "command", "entrypoint")
_HINT = "list it under the service's 'secrets' and read the file /run/secrets/NAME"


def sources(root: Map, folder: str, findings: Findings) -> Mapping[str, SecretSource]:
    """Return where each secret comes from, by name."""
    given = root.entries.get("secrets")
    found = {}
    if isinstance(given, Map):
        for name, entry in sorted(given.entries.items()):
            if isinstance(entry, Map) and not findings.broken(("secrets", name)):
                found[name] = _source(name, given.keys[name], entry, folder, findings)
    return MappingProxyType(found)


def files_of(path: str) -> set[str]:
    """Return the real paths of files that an EDF calls secrets', whatever is wrong with it but that it is no YAML."""
    found: set[str] = set()
    with contextlib.suppress(DefinitionError), allowance(schema.MOST_BYTES, schema.MOST_VALUES):
        root = loader.read(path)
        given = root.entries.get("secrets") if isinstance(root, Map) else None
        for entry in given.entries.values() if isinstance(given, Map) else ():
            file = entry.entries.get("file") if isinstance(entry, Map) else None
            if isinstance(file, Scalar):
                found.add(_real(os.path.dirname(os.path.abspath(path)), file.text))
    return found


def _source(name: str, key: Scalar, entry: Map, folder: str, findings: Findings) -> SecretSource:
    file, command, env = entry.entries.get("file"), entry.entries.get("command"), entry.entries.get("env")
    if env is not None and is_gone_by(text(env)):
        hint = "give the secret a variable of its own"
        message = f"'{text(env)[:60]}' is a variable that srprov itself goes by, and no secret"
        findings.add(env, message, ("secrets", name, "env"), hint, code=Code.SECRET)
    words: tuple[str, ...] = ()
    if command is not None:
        try:
            words = values.command_words(command) or ()
        except ValueError as error:
            findings.add(command, str(error), ("secrets", name, "command"), code=Code.SECRET)
    if command is not None and (not words or not words[0]) and not findings.broken(("secrets", name)):
        findings.add(command, "the command is empty", ("secrets", name, "command"), code=Code.SECRET)
    place = next((value for part, value in entry.entries.items() if not part.startswith("x-")), key)
    return SecretSource(
        name=name,
        env=text(env),
        file=_real(folder, text(file)) if file is not None else "",
        command=words,
        folder=folder,
        location=nodes.location(place),
        excerpt=place.source.excerpt(place.line),
    )


def _real(folder: str, file: str) -> str:
    """Return the file that a path leads to: a link has any name, and plans and permissions show what is read."""
    path = os.path.join(folder, os.path.expanduser(file))
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):  # a NUL, or half of a surrogate pair: who reads it says so
        return path


def with_secrets(service: Service, entry: Map, root: Map, findings: Findings) -> Service:
    """Return a service with its secrets; one that cannot be mounted where it is asked for is a problem."""
    path: Path = ("services", service.name)
    found = _uses(entry.entries.get("secrets"), root, findings, (*path, "secrets"))
    _check_targets(entry, found, service.runtime.mounts, findings, (*path, "secrets"))
    for key in _ELSEWHERE:
        _check_elsewhere(key, entry.entries.get(key), findings, (*path, key))
    return replace(service, secrets=found)


def target_of(item: Node) -> str:
    """Return where a service has a secret, as an item of its `secrets` says."""
    return _use(item).target


def _uses(node: Node | None, root: Map, findings: Findings, path: Path) -> tuple[SecretUse, ...]:
    """Read a service's `secrets`, in the order written."""
    given = root.entries.get("secrets")
    known = given.entries if isinstance(given, Map) else {}
    by_target: dict[str, SecretUse] = {}
    for item in node.items if isinstance(node, Seq) else ():
        place = item.entries["source"] if isinstance(item, Map) else item
        use = _use(item)
        if use.source not in known:
            hint = did_you_mean(use.source, known) or "name it in the experiment's 'secrets', with where it comes from"
            findings.add(place, f"there is no secret '{use.source[:60]}'", path, hint, code=Code.NO_SUCH_NAME)
        if use.target in by_target:
            findings.add(
                item,
                f"'{use.target}' is mounted twice; already as '{by_target[use.target].source}'",
                path,
                code=Code.SECRET,
            )
        if not use.target.startswith("/") or use.target in ("/", _FOLDER):
            findings.add(item, f"'{use.target[:60]}' is no place for a file", path, code=Code.SECRET)
        by_target[use.target] = use
    return tuple(by_target.values())


def _use(item: Node) -> SecretUse:
    if not isinstance(item, Map):
        return SecretUse(source=text(item), target=f"{_FOLDER}/{text(item)}", mode=_MODE)
    name = text(item.entries.get("source"))
    target = posixpath.normpath(posixpath.join(_FOLDER, text(item.entries.get("target"), name)))
    return SecretUse(source=name, target=target, mode=text(item.entries.get("mode"), _MODE).zfill(4))


def _check_targets(
    entry: Map, found: tuple[SecretUse, ...], mounts: tuple[Mount, ...], findings: Findings, path: Path
) -> None:
    """Add a secret at a place where a volume is mounted, or inside a read-only one, where Docker cannot put it."""
    every = {mount.target for mount in mounts}
    read_only = tuple(f"{mount.target.rstrip('/')}/" for mount in mounts if mount.read_only)
    for use in found:
        if use.target in every or use.target.startswith(read_only):
            message = f"the secret '{use.source}' would lie at '{use.target}', where a volume is mounted"
            findings.add(
                nodes.key_or_value(entry, "secrets"), message, path, "give it another target", code=Code.SECRET
            )


def _check_elsewhere(key: str, node: Node | None, findings: Findings, path: Path) -> None:
    """Add every secret in `environment` or a command: `docker inspect` would show it to everybody on the robot."""
    for item in _texts(node):
        if isinstance(item, Map) or _PLACEHOLDER.search(item.text):
            findings.add(
                item,
                f"a secret in '{key}' is not supported: Docker would show its value",
                path,
                _HINT,
                code=Code.SECRET,
            )


def _texts(node: Node | None) -> Iterator[Scalar | Map]:
    if isinstance(node, Scalar):
        yield node
    for item in node.items if isinstance(node, Seq) else node.entries.values() if isinstance(node, Map) else ():
        if isinstance(item, Scalar) or (isinstance(item, Map) and {"secret", "from_secret"} & set(item.entries)):
            yield item
