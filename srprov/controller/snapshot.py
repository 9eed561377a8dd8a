"""Robots that were set up by hand -> a folder with an experiment; nothing is changed on any robot.

Takes the fleet; writes the folder as a whole, once what is in it was read back and is valid. A part of a definition
that srprov's own rules refuse is left out and noted, so that a robot's odd words do not cost the rest.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from srprov import believed, private
from srprov.codes import Code
from srprov.controller.fleet import Fleet
from srprov.controller.snapshot_apart import apart
from srprov.controller.snapshot_check import Checker, hidden
from srprov.controller.snapshot_look import Seen, look
from srprov.controller.snapshot_words import Words, is_our_own
from srprov.errors import TransportError, UsageError
from srprov.robot_answers import answers_of
from srprov.secret import Secret
from srprov.snapshot import report
from srprov.snapshot.containers import service_of
from srprov.snapshot.folder import Definition, Robot, definition_of
from srprov.snapshot.hider import Hider
from srprov.snapshot.mounts import volumes_there
from srprov.snapshot.names_there import NamesThere
from srprov.snapshot.secret_names import SecretNames
from srprov.snapshot.settings import service_name
from srprov.snapshot.volume_names import VolumeNames
from srprov.snapshot.without import all_without, another_s
from srprov.untrusted import mapping, string

REPORT = "report.md"
_MOST_KNOWN = 100
_VOCABULARY = "experiment robots secrets notes unreachable services packages installed repositories workspaces commit"
_SERVICES = 900
"""Of an experiment; an EDF takes 1000."""


def snapshot(fleet: Fleet, target: Path, name: str) -> dict[str, Any]:
    """Look at all robots of the fleet and write the experiment; return the report as JSON values.

    Raises:
        UsageError: The folder is not empty or cannot be written, or no robot has a container or a known system.
    """
    _check_target(target)
    seen, unreachable = _look(fleet)
    if not seen:
        why = "; ".join(f"{k}: {v}" for k, v in sorted(unreachable.items()))
        raise UsageError(f"no robot could be looked at: {why}", code=Code.NO_ROBOT)
    robots = _robots(seen)
    try:
        hider = Hider(value for robot in robots for one in robot.services for value in one.hidden)
    except ValueError as error:
        raise UsageError(f"{error} in containers", hint="name fewer robots at once", code=Code.TOO_LARGE) from error
    _make_known(hider, [word for robot in robots for word in (robot.name, *(one.name for one in robot.services))])
    words = Words(robots)
    robots, definitions = _without_secrets(robots, hider)
    with _draft(target) as draft, believed.to_fill(str(draft)) as opened:
        place = Path(opened)
        robots, definitions = Checker(place, apart(robots), definitions, hider).checked(name)
        if not definitions and not any(robot.services for robot in robots):
            found = [f"{robot.name}: {note.subject}: {note.words}" for robot in robots for note in robot.notes.all()]
            raise UsageError(f"there is nothing to write: {'; '.join(found[:5])}", code=Code.NOTHING_RUNS)
        document = report.document(name, robots, definitions, unreachable)
        clean = words.clean(document)
        private.write_file(place / REPORT, report.markdown(clean))
        _put(draft, target)
    return {"folder": str(target), **clean}


def _check_target(target: Path) -> None:
    try:
        if target.exists() and (not target.is_dir() or any(target.iterdir())):
            raise UsageError(f"{target} is there already", hint="name a new folder with -o", code=Code.IN_THE_WAY)
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}", code=Code.CANNOT_WRITE) from error


def _look(fleet: Fleet) -> tuple[list[Seen], dict[str, str]]:
    """Ask all robots at the same time."""
    names = sorted(fleet.inventory.hosts)
    seen, unreachable = [], {}
    with ThreadPoolExecutor(max(1, min(len(names), fleet.forks))) as pool:
        asked = {name: pool.submit(_one, fleet, name) for name in names}
        for name, future in asked.items():
            try:
                seen.append(future.result())
            except TransportError as error:
                unreachable[name] = error.told
    return seen, unreachable


def _one(fleet: Fleet, name: str) -> Seen:
    session = fleet.sessions.get(name)
    with answers_of(name):
        return look(session, name)


def _robots(seen: Sequence[Seen]) -> list[Robot]:
    """Return the robots with their containers as services, whose names are all different."""
    shorts: dict[str, str] = {}
    for one in seen:
        shorts[one.name] = _fresh(service_name(one.name), shorts.values())
    taken = {f"{short}-host" for short in shorts.values()}
    there = NamesThere({one.name: [box for box, _ in one.containers] for one in seen})
    given, volumes, robots = SecretNames(), VolumeNames(), []
    for one in seen:
        robot = Robot(
            name=one.name, short=shorts[one.name], host=one.host, repositories=one.repositories, notes=one.notes
        )
        fit = len(taken) + len(one.containers) <= _SERVICES  # all or none: others would choose which of them
        if not fit:
            one.notes.lost("containers", f"with them an experiment had more than {_SERVICES} services: none is in it")
        services = []
        for box, image in one.containers if fit else ():
            name = _name_of(box, robot, taken, there)
            taken.add(name)
            try:
                with answers_of(one.name):
                    made = service_of(name, box, image, one.runtime, one.notes, given.of(one.name))
                    made = volumes.named(one.name, robot.short, made, volumes_there(mapping(box)), one.notes)
                    services.append(there.without_hostname(one.name, made, one.notes))
            except TransportError as error:
                one.notes.lost(f"container {name}", error.message)
        robots.append(replace(robot, services=tuple(services)))
    return robots


def _name_of(box: Mapping[str, Any], robot: Robot, taken: Collection[str], there: NamesThere) -> str:
    """Return what a container is called as a service: nothing by which another robot's containers mean a host."""
    own = service_name(string(mapping(box).get("Name")).lstrip("/"))
    if own not in taken and not there.mean_others(robot.name, own):
        return own
    name = f"{own[:40]}-{robot.short[:18]}"
    name = _fresh(name, taken, lambda one: there.mean_others(robot.name, one))
    if own not in taken:
        robot.notes.adapted(f"container {name}", f"containers of another robot use the name {own} for something else")
    return name


def _fresh(name: str, taken: Collection[str], unfit: Callable[[str], bool] = lambda _name: False) -> str:
    found, number = name, 2
    while found in taken or unfit(found):
        found, number = f"{name[:46]}-{number}", number + 1
    return found


def _make_known(hider: Hider, names: Sequence[str]) -> None:
    """Let all output of this process hide the values; not a word of the report's own, or it could not be read."""
    for value in hider.strong[:_MOST_KNOWN]:
        known = value.strip().lower() in _VOCABULARY or is_our_own(value)
        if not known and not any(value.strip() in name for name in names):
            with contextlib.suppress(ValueError):  # too short to be hidden
                Secret(value)


def _without_secrets(robots: Sequence[Robot], hider: Hider) -> tuple[list[Robot], dict[str, Definition]]:
    """Return robots, and robot -> the CDF of its host, in which no secret of theirs stands once more."""
    own = {robot.name: Hider(value for one in robot.services for value in one.hidden) for robot in robots}
    clean = [_cleaned(robot, hider, own[robot.name]) for robot in robots]
    return clean, {robot.name: one for robot in clean if (one := _definition(robot, hider, own[robot.name]))}


def _definition(robot: Robot, hider: Hider, own: Hider) -> Definition | None:
    """Return the CDF of a robot's host; none that would lack what another robot says is a secret of its own."""
    one = definition_of(robot)
    if one is None or hidden(one.values, hider) == hidden(one.values, own):
        return one
    why = "a word of it is a secret of another robot: it is left out; look at this robot alone to have it"
    robot.notes.lost(f"host {robot.name}", why)
    return None


def _cleaned(robot: Robot, hider: Hider, own: Hider) -> Robot:
    """Return a robot in whose services and patches no secret stands once more."""
    texts = [one.patch.decode("utf-8", "surrogateescape") for one in robot.repositories]
    strange = any(another_s(one, hider, own) for one in texts)  # which one is, would tell it what the secret is
    repositories = []
    for one, text in zip(robot.repositories, texts, strict=True):
        if one.patch and (strange or own.without(text) != text):
            whose = "of this robot's hold a secret of another" if strange else "hold a value that is a secret"
            robot.notes.secret(f"repository {one.folder}", f"changes {whose}: there is no patch")
            repositories.append(replace(one, patch=b""))
        else:
            repositories.append(one)
    services = all_without(robot.services, hider, own, robot.notes)
    return replace(robot, services=services, repositories=tuple(repositories))


@contextlib.contextmanager
def _draft(target: Path) -> Iterator[Path]:
    """Give a new folder beside the target; it is gone afterwards."""
    try:
        parent = target.absolute().parent
        parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{target.name[:60]}.", dir=parent))
    except OSError as error:
        raise UsageError(f"{error.filename or target}: {error.strerror}", code=Code.CANNOT_WRITE) from error
    try:
        yield draft
    except OSError as error:
        raise UsageError(f"{error.filename or target}: {error.strerror}", code=Code.CANNOT_WRITE) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _put(draft: Path, target: Path) -> None:
    """Put the folder into its place, which is empty or not there."""
    if target.is_dir() and not target.is_symlink():
        target.rmdir()
    os.rename(draft, target)
