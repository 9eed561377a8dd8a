"""The packages that builds ended with, for the lock: read from images that this machine had built, where they are.

Takes a lock whose names are all known, and the robots; gives the lock with records. On each robot that is read, a
container runs for a moment, with the robot's lock held.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from srprov import disk
from srprov.codes import Code
from srprov.controller.digests import PLATFORM, AskEach
from srprov.controller.image_plans import plan_images
from srprov.controller.pins import pinned
from srprov.definitions.lockfile import Lock, Packages
from srprov.definitions.model import BUILDERS
from srprov.errors import LockHeld, TransportError
from srprov.execution.lock_set import LockOptions, LockSet
from srprov.execution.locks import claim
from srprov.execution.packages import KINDS, NoListing, packages_in, remove_left
from srprov.image_reference import parse_reference
from srprov.record.memory import built_for, known_images
from srprov.untrusted import mapping, string
from srprov.wire import EngineQuery

if TYPE_CHECKING:
    from srprov.controller.locking import Draft
    from srprov.facts.gather import Gathering
    from srprov.session import Session

MOST = 900
MOST_IN_ALL = 5_000
"""Packages of a kind in one record, and of all records: a lock is read again with each plan."""
_NO_BASE = ("", "scratch")
_NOT_LISTED = "the packages in it are not in the lock: "


class _Read(msgspec.Struct, frozen=True):
    """What is to be read: an image on a robot."""

    robot: str
    tag: str
    platform: str
    image: str
    """Its id."""
    base: str
    """What its last stage starts from."""
    builder: bool
    """The robot built it, and builds for others; any other one that has it, too, only says what is in it."""


def with_records(lock: Lock, made: Draft, look: Gathering, sessions: Mapping[str, Session]) -> tuple[Lock, list[str]]:
    """Return the lock with a record for each image that was built and is there, and in words what came of each.

    Args:
        lock: With all digests and commits.
        made: What it was made from.
        look: Asks robots.
        sessions: The robots that can be reached.

    Raises:
        DefinitionError: A CDF cannot become an image.
    """
    with disk.together():
        images = plan_images(pinned(made.definitions, lock).containers)[0]
    bases = {plan.tag: plan.base for plan in images.values()}
    if not bases:
        return lock, []
    records = {(one.image, one.platform): one for one in made.kept.packages if one.image in bases}
    engines = {robot: facts.arch for robot, facts in look.first().facts.items() if facts.docker}
    builders = look.inventory.groups.get(BUILDERS, ()) or engines
    identities = {robot: sessions[robot].identity for robot in engines if robot in builders and robot in sessions}
    wanted = _wanted(bases, records, look.ask_each, engines, identities)
    told = [
        f"{tag}: {_NOT_LISTED}no robot has an image of it that was built from here; `srprov build`, then lock again"
        for tag in sorted(bases.keys() - {one.tag for one in wanted} - {image for image, _ in records})
    ]
    for one, found in _read_all(wanted, sessions):
        if isinstance(found, str):
            words = f"{_NOT_LISTED}{found}"
        elif sum(each.count for each in (*records.values(), found)) > MOST_IN_ALL:
            words = f"{_NOT_LISTED}it has at most {MOST_IN_ALL} of all images"
        else:
            records[(one.tag, one.platform)] = found
            words = f"{found.count} package{'s' * (found.count != 1)} beyond those of its base are in the lock"
            words += "" if one.builder else ", by the word of a robot from which others do not have it"
        told.append(f"{one.tag} on {one.robot}: {words}")
    return replace(lock, packages=tuple(records[key] for key in sorted(records))), told


def _wanted(
    bases: Mapping[str, str], known: Collection[tuple[str, str]], ask_each: AskEach, robots: Mapping[str, str],
    identities: Mapping[str, str],
) -> list[_Read]:  # fmt: skip
    """Return where each image is read: for each platform on a robot that has it as it was built from here.

    That is who built it, who is trusted with it, or else the first one by name: what a robot lists of an image is its
    word, whatever id it says that this has. `robots` says of what architecture each is, `identities` who those that
    build for others prove to be.
    """
    tags = sorted(bases)
    ours = {key: {one.partition(" ")[::2] for one in built} for key, built in known_images().items()}
    questions = [EngineQuery(path=f"/images/{tag}/json") for tag in tags]
    replies = ask_each(dict.fromkeys(robots, questions)) if tags else {}
    wanted: dict[tuple[str, str], _Read] = {}
    for robot, answers in sorted(replies.items()):
        for tag, reply in zip(tags, answers, strict=True):
            said = mapping(reply.json()) if reply.ok else {}
            platform, image = _platform(said), string(said.get("Id"))
            who = {by for one, by in ours.get(built_for(tag, robots[robot]), ()) if one == image}
            if not platform or not who or (tag, platform) in known:
                continue
            one = _Read(robot, tag, platform, image, bases[tag], builder=identities.get(robot) in who)
            if one.builder > wanted.setdefault((tag, platform), one).builder:
                wanted[tag, platform] = one
    return list(wanted.values())


def _platform(said: Mapping[str, object]) -> str:
    words = [string(said.get(key)) for key in ("Os", "Architecture", "Variant")]
    platform = "/".join(word for word in words if word)
    return platform if PLATFORM.fullmatch(platform) else ""


def _read_on(session: Session, wanted: Sequence[_Read]) -> Iterator[tuple[_Read, Packages | str]]:
    """Lock a robot, and yield what was read of images there.

    Raises:
        LockHeld: Somebody else holds the robot.
        TransportError: It cannot be locked, or not be talked to any more.
    """
    robot, never = session.host, threading.Event()
    options = LockOptions(copied_to=frozenset({robot}))  # what a cut copy has sent is left to the next apply
    with LockSet([robot], {robot: session}, claim("lock"), options, never, lambda _event: None).acquire() as held:
        if why := held.lost.get(robot):
            raise TransportError(robot, why, code=Code.LOST)
        remove_left(session)
        listed: dict[str, Mapping[str, frozenset[str]]] = {}
        for one in wanted:
            try:
                yield one, _record(session, one, listed)
            except NoListing as error:
                yield one, str(error)


def _record(session: Session, one: _Read, listed: dict[str, Mapping[str, frozenset[str]]]) -> Packages:
    """Return what an image has beyond its base; `listed` has what was listed before, by the image's id.

    Raises:
        NoListing: One of them is not there, or does not say what it has.
        TransportError: The robot cannot be talked to any more.
    """
    base = "" if one.base in _NO_BASE else _base_id(session, one.base)
    for image in filter(None, (base, one.image)):
        if image not in listed:
            listed[image] = packages_in(session, image)
    inside, below = listed[one.image], listed.get(base, {})
    more = {kind: tuple(sorted(inside[kind] - below.get(kind, frozenset()))) for kind in KINDS}
    for kind, names in more.items():
        if len(names) > MOST:
            raise NoListing(f"it has {len(names)} packages of {kind} beyond its base; {MOST} are the most")
    return Packages(image=one.tag, platform=one.platform, **more)


def _base_id(session: Session, base: str) -> str:
    try:
        name = parse_reference(base).familiar
    except ValueError:
        raise NoListing(f"a variable stands in the name of its base, {base}") from None
    (reply,) = session.ask([EngineQuery(path=f"/images/{name}/json")])
    found = string(mapping(reply.json()).get("Id")) if reply.ok else ""
    if not found:
        raise NoListing(f"its base {name} is not there any more, so that nobody can tell what was added")
    return found


def _read_all(wanted: Sequence[_Read], sessions: Mapping[str, Session]) -> Iterator[tuple[_Read, Packages | str]]:
    """Yield what was read of each image, or why nothing was."""
    robots = sorted({one.robot for one in wanted})
    for robot in robots:
        mine = [one for one in wanted if one.robot == robot]
        try:
            yield from _read_on(sessions[robot], mine)
        except (LockHeld, TransportError) as error:
            yield from ((one, error.message) for one in mine)
