"""One robot, looked at for a snapshot: a few round trips of questions that only read.

Takes a Reader; gives what it said, already read. The first round trip asks the host and lists containers; the second
inspects these and asks apt where packages come from; further ones ask repositories, and what changed in containers.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from srprov.modules.container_names import instance_of
from srprov.names import few
from srprov.session import Reader
from srprov.snapshot.changes import changes, changes_query
from srprov.snapshot.debian import parse_policy, policy_query
from srprov.snapshot.gitscript import TIMEOUT_S, script
from srprov.snapshot.host import Host, read_host, with_origins
from srprov.snapshot.notes import Notes
from srprov.snapshot.questions import ENGINE, QUESTIONS
from srprov.snapshot.repositories import MOST_PATCHES, Repository, parse_repository
from srprov.snapshot.sources import keys_query, origins_query, parse_keys, parse_origins
from srprov.untrusted import (
    absolute,
    is_of_one,
    mapping,
    mappings,
    string,
    strings,
    text,
)
from srprov.wire import AnyQuery, EngineQuery, Query, Reply

_T = TypeVar("_T")
MOST_CONTAINERS = 200
_CONTAINERS_AT_ONCE = 8
_REPOSITORIES_AT_ONCE = 4
"""Of one round trip: so many answers together are short enough."""
_PATIENCE_S = 90.0
"""For the repositories of a robot; a user of it could make them slow."""
_ID = re.compile(r"[0-9a-f]{64}")
_IMAGE = re.compile(r"sha256:[0-9a-f]{64}")
MOST_INSPECTED = 8 << 20
"""Characters of what an engine says of all containers and their images; of one they are some ten thousand."""
LONGEST_S = 600.0
"""Until no further container of a robot is asked about: each answer may take its time."""
_RUNS = ("running", "paused", "restarting")
_SHOWN = 6


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot said."""

    name: str
    host: Host
    repositories: tuple[Repository, ...] = ()
    containers: tuple[tuple[Mapping[str, Any], Mapping[str, Any]], ...] = ()
    """(container, image) as the engine has them."""
    runtime: str = "runc"
    notes: Notes = msgspec.field(default_factory=Notes)


def look(reader: Reader, name: str) -> Seen:
    """Ask one robot everything.

    Raises:
        TransportError: It cannot be talked to any more.
    """
    notes = Notes(robot=name)
    replies = reader.ask([*(question.query() for question in QUESTIONS), *ENGINE])
    host = read_host(replies[: len(QUESTIONS)], notes)
    listed, info = replies[len(QUESTIONS) :]
    chosen = _chosen(listed, notes)
    wanted = [*host.chosen.by_hand, *host.chosen.others]
    origins: list[AnyQuery] = [origins_query(), policy_query(one.name for one in wanted)] if wanted else []
    containers: list[tuple[Mapping[str, Any], Mapping[str, Any]]] = []
    room, end = MOST_INSPECTED, time.monotonic() + LONGEST_S
    questions = [question for one, image in chosen for question in _inspect(one, image)]
    for some in _pieces(questions, 2 * _CONTAINERS_AT_ONCE) or [()]:
        answers = list(reader.ask([*origins, *some]))
        if origins:
            signed, policy = parse_origins(answers[0].out), parse_policy(answers[1].out)
            host = with_origins(host, policy, signed, notes)
        answers = answers[len(origins) :]
        containers += _inspected(answers, notes)
        origins = []
        room -= sum(len(one.out) for one in answers)
        if room < 0 or time.monotonic() > end:
            notes.lost("containers", "what is said of them is too long, or takes too long: there may be more")
            break
    if host.elsewhere and host.sources:
        host = replace(host, keys=parse_keys(reader.ask([keys_query(host.sources, root=host.root)])[0].out))
    _note_changes(reader, containers, end, notes)
    return Seen(
        name=name,
        host=host,
        repositories=tuple(_repositories(reader, host, notes)),
        containers=tuple(containers),
        runtime=text(mapping(info.json()).get("DefaultRuntime"), length=60) or "runc",
        notes=notes,
    )


def _pieces(items: Sequence[_T], size: int) -> list[Sequence[_T]]:
    return [items[at : at + size] for at in range(0, len(items), size)]


def _chosen(listed: Reply, notes: Notes) -> list[tuple[str, str]]:
    """Return (container, image) ids of those that run and are nobody's instance."""
    if not listed.ok:
        notes.lost("containers", f"the Docker Engine does not list them: {listed.err or listed.status}")
        return []
    found = []
    for one in mappings(listed.json()):
        identity, image = string(one.get("Id")), string(one.get("ImageID"))
        subject = f"container {text(next(iter(strings(one.get('Names'))), identity[:12]), length=80).lstrip('/')}"
        instance = instance_of(one)
        if not _ID.fullmatch(identity) or not _IMAGE.fullmatch(image):
            notes.lost(subject, "the engine gives it no id, or no image")
        elif instance:
            notes.adapted(subject, f"belongs to the instance {text(instance, length=40)}: its own EDF says what it is")
        elif string(one.get("State")) not in _RUNS:
            notes.lost(
                subject, f"does not run ({text(string(one.get('Status')), length=60)}): start it, and look again"
            )
        else:
            found.append((identity, image))
    if len(found) > MOST_CONTAINERS:
        notes.lost("containers", f"only {MOST_CONTAINERS} of {len(found)} are captured")
    return sorted(found)[:MOST_CONTAINERS]


def _inspect(container: str, image: str) -> tuple[EngineQuery, EngineQuery]:
    return (
        EngineQuery(path=f"/containers/{container}/json"),
        EngineQuery(path=f"/images/{image}/json"),
    )


def _inspected(replies: Sequence[Reply], notes: Notes) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    for box, image in zip(replies[::2], replies[1::2], strict=True):
        if not (is_of_one(box.out) and is_of_one(image.out)):
            notes.lost("container", "what the engine says of it is longer than any container needs: it is not read")
            continue
        about = mapping(box.json())
        if not box.ok or not image.ok or not _ID.fullmatch(string(about.get("Id"))):
            notes.lost("container", f"cannot be looked at, or went away meanwhile: {text(box.err or image.err)}")
        else:
            yield about, mapping(image.json())


def _note_changes(
    reader: Reader, containers: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], end: float, notes: Notes
) -> None:
    """Note what was changed in the files of containers, each asked by itself: such an answer may be long.

    An engine that is asked for it goes through them among the robot's own files, and the container, which runs, leads
    it elsewhere: it opened a pipe of the robot's, and hung. So the robot looks itself, where nothing else is.
    """
    for box, _ in containers:
        subject = f"container {text(string(box.get('Name')), length=80).lstrip('/')}"
        if time.monotonic() > end:
            notes.lost("containers", "what was changed in their files takes too long to be listed")
            return
        upper = absolute(mapping(mapping(box.get("GraphDriver")).get("Data")).get("UpperDir"))
        (reply,) = reader.ask([changes_query(upper)]) if upper else (Reply(status=1, ok=False),)
        if not reply.ok:
            notes.lost(subject, "what was changed in its files cannot be listed")
            continue
        bytes_, changed = changes(reply.out)
        if changed:
            shown = few([text(path, length=50) for path in changed], _SHOWN)
            notes.lost(subject, f"files changed since it was made ({bytes_} bytes): {shown}")


def _repositories(reader: Reader, host: Host, notes: Notes) -> Iterator[Repository]:
    room, said, begun = MOST_PATCHES, 0, time.monotonic()
    for some in _pieces(host.found, _REPOSITORIES_AT_ONCE):
        if time.monotonic() - begun > _PATIENCE_S:
            notes.lost("repositories", f"{some[0].folder} and those after it are not read: the others took too long")
            return
        queries = [Query(command=script(one, root=host.root), timeout_s=TIMEOUT_S) for one in some]
        for found, reply in zip(some, reader.ask(queries), strict=True):
            said += len(reply.out)
            if said > 3 * MOST_PATCHES:  # looking for secrets in patches takes its time
                notes.lost(f"repository {found.folder}", "is not read: others say too much already")
                continue
            one = parse_repository(found, reply.out, notes)
            if one is None:
                continue
            room -= len(one.patch)
            if room < 0 and one.patch:
                notes.lost(f"repository {one.folder}", "has no patch: those of others are long already")
                one = Repository(folder=one.folder, url=one.url, commit=one.commit, branch=one.branch)
            yield one
