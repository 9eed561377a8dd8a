"""List the packages in an image on a robot: by a container of it that is cut off from everything and removed again.

Takes a session whose robot is locked. What the container prints is the image's own word: it is bounded, and names and
versions are compared with the forms that they have.
"""

from __future__ import annotations

import contextlib
import json
import re
import secrets
import time
from collections.abc import Iterator, Mapping

from srprov.errors import TransportError
from srprov.modules.container import ContainerModule
from srprov.modules.container_commands import NOT_OF_COMPOSE, remove
from srprov.modules.container_leftover import BUILD, LISTING
from srprov.session import Session
from srprov.untrusted import json_or_none, mapping, mappings, string, text
from srprov.wire import EngineCall, Reply

KINDS = ("apt", "pip", "npm")
_LISTING_S = 60.0
_MOST_LINES = 50_000
_MOST_CHARACTERS = 8 << 20
_NAME = re.compile(r"[A-Za-z0-9@][A-Za-z0-9@/+._-]{0,127}")
_VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+:~!_-]{0,127}")
_LINKS = {"apt": "=", "pip": "==", "npm": "@"}
"""What stands between name and version in a CDF."""
_SCRIPT = r"""exec 2>/dev/null
dpkg-query -W -f 'apt ${db:Status-Abbrev} ${Package} ${Version}\n'
printf 'pip '; python3 -m pip list --verbose --format=json --disable-pip-version-check; echo
printf 'npm '; npm ls --global --depth=0 --json | tr -d '\n'; echo
"""
_MIB = 1 << 20
_HOST = {
    "NetworkMode": "none",
    "CapDrop": ["ALL"],
    "SecurityOpt": ["no-new-privileges"],
    "ReadonlyRootfs": True,
    "PidsLimit": 64,
    "Memory": 512 * _MIB,
    "LogConfig": {"Type": "json-file", "Config": {"max-size": "8m", "max-file": "1"}},
}


class NoListing(Exception):
    """An image's packages could not be listed; the text says why."""


def packages_in(session: Session, image_id: str) -> Mapping[str, frozenset[str]]:
    """Return kind -> packages with their versions, each as a CDF would name it, such as `curl=7.88.1-10`.

    Of pip's, only what pip itself installed: it lists those of apt too.

    Raises:
        NoListing: There is no such image, it has no shell, or it took too long.
        TransportError: The robot cannot be talked to any more.
    """
    with _container(session, image_id) as name:
        _done(session, "POST", f"/containers/{name}/start")
        began = time.monotonic()
        try:
            _done(session, "POST", f"/containers/{name}/wait", timeout_s=_LISTING_S)
        except NoListing:
            if time.monotonic() - began < _LISTING_S:
                raise
            raise NoListing(f"it takes longer than {_LISTING_S:g} s to list them") from None
        try:
            return parsed(session.container_log(name, tail=_MOST_LINES, follow=False))
        except TransportError as error:
            raise NoListing(error.message) from error


def remove_left(session: Session) -> None:
    """Remove what a `lock` that was cut off left on a robot: what is in an image may run for ever.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    containers = ContainerModule()
    for one in containers.parse(session.ask(containers.queries())):
        if one.name.startswith(LISTING):
            session.execute(remove(one.name))


@contextlib.contextmanager
def _container(session: Session, image_id: str) -> Iterator[str]:
    """Create a container, and remove it with its volumes. One that a kill leaves is what `remove_left` finds."""
    name = f"{LISTING}{secrets.token_hex(6)}"
    body = {
        "Image": image_id,
        "Entrypoint": ["/bin/sh", "-c", _SCRIPT],
        "Cmd": [],
        "WorkingDir": "/",
        "Labels": {"srprov.instance": BUILD, **NOT_OF_COMPOSE},
        "Healthcheck": {"Test": ["NONE"]},
        "HostConfig": _HOST,
    }
    try:
        _done(session, "POST", "/containers/create", params=(("name", name),), body=json.dumps(body))
        yield name
    finally:
        session.execute(remove(name))


def _done(
    session: Session, method: str, path: str, *, params: tuple[tuple[str, str], ...] = (), body: str = "",
    timeout_s: float = 60.0,
) -> Reply:  # fmt: skip
    call = EngineCall(method=method, path=path, params=params, body=body, timeout_s=timeout_s)
    reply = session.execute(call)
    if not reply.ok:
        raise NoListing(text(reply.err, length=300))
    return reply


def parsed(lines: Iterator[str]) -> Mapping[str, frozenset[str]]:
    """Return kind -> packages, of what an image printed; whatever has not their form is left out."""
    found: dict[str, set[str]] = {kind: set() for kind in KINDS}
    characters = 0
    for number, line in enumerate(lines):
        characters += len(line)
        if number >= _MOST_LINES or characters > _MOST_CHARACTERS:
            break
        kind, _, rest = line.partition(" ")
        for name, version in _pairs(kind, rest):
            if _NAME.fullmatch(name) and _VERSION.fullmatch(version):
                found[kind].add(f"{name}{_LINKS[kind]}{version}")
    return {kind: frozenset(ones) for kind, ones in found.items()}


def _pairs(kind: str, rest: str) -> list[tuple[str, str]]:
    if kind == "apt":
        words = rest.split(None, 3)
        return [(words[1], words[2])] if len(words) == 3 and words[0] == "ii" else []
    if kind == "pip":
        ours = (one for one in mappings(json_or_none(rest)) if one.get("installer") == "pip")
        return [(string(one.get("name")), string(one.get("version"))) for one in ours]
    if kind == "npm":
        listed = mapping(mapping(json_or_none(rest)).get("dependencies"))
        return [(string(name), string(mapping(one).get("version"))) for name, one in listed.items()]
    return []
