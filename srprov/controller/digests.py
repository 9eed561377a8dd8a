"""What the tags of images are now: asked of registries through robots' engines.

Takes a way to ask robots, and names; gives digests. Only reads. The controller needs no Docker, and a registry is asked
from where images will be pulled.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

from srprov.codes import Code
from srprov.errors import UsageError, one_line
from srprov.image_reference import parse_reference
from srprov.planning.policy import Permission, require
from srprov.untrusted import mapping, mappings, string
from srprov.wire import AnyQuery, EngineQuery, Reply

AskEach = Callable[[Mapping[str, Sequence[AnyQuery]]], Mapping[str, Sequence[Reply]]]
"""Robot -> questions, in; robot -> replies, out, without robots that failed."""
MOST_ROBOTS = 3
"""That are asked for the same: they must agree, as one alone could say what it likes."""
_DIGEST = re.compile(r"sha256:[0-9a-f]{64}")
PLATFORM = re.compile(r"[a-z0-9]{1,16}/[a-z0-9]{1,16}(/v[0-9]{1,2})?")
_MOST_PLATFORMS = 100
"""Of an image, that a robot tells: a lock of more could not be read again."""
_LONG_S = 60.0

Found = tuple[str, tuple[str, ...]]
"""(digest, platforms)"""


def look_up(
    ask_each: AskEach, robots: Iterable[str], names: Collection[str], allowed: Collection[str],
    say: Callable[[str], None],
) -> dict[str, Found]:  # fmt: skip
    """Return full name with tag -> what it is now.

    Args:
        ask_each: Asks robots.
        robots: Those that may be asked; the first few are.
        names: Full names with tags.
        allowed: Kinds of permission that the user gave: to look a name up is to have engines ask.
        say: What is told of a name of which one robot alone says what it is, where others were asked, too.

    Raises:
        RefusedError: Whom a name would have engines ask, the user did not allow.
        UsageError: No registry tells a name to any robot, or robots disagree.
    """
    asked, wanted = sorted(robots)[:MOST_ROBOTS], sorted(names)
    require(list(_beyond(wanted)), allowed)
    questions = [
        EngineQuery(path=f"/distribution/{parse_reference(name).familiar}/json", timeout_s=_LONG_S) for name in wanted
    ]
    replies = ask_each(dict.fromkeys(asked, questions)) if wanted else {}
    return {
        name: _agreed(name, asked, {robot: answers[index] for robot, answers in replies.items()}, say)
        for index, name in enumerate(wanted)
    }


def _beyond(names: Iterable[str]) -> Iterator[Permission]:
    """Yield what it takes to look up names whose registry is whoever that is in a robot's own network."""
    for name in names:
        reference = parse_reference(name)
        if reference.is_private:
            what = "looking it up, the robots' engines ask whoever that is in their own network"
            yield Permission(kind="engine-fetch", service=reference.familiar, what=what)


def _agreed(name: str, asked: Sequence[str], replies: Mapping[str, Reply], say: Callable[[str], None]) -> Found:
    short = parse_reference(name).familiar
    found = {robot: one for robot, reply in sorted(replies.items()) if (one := _digest(reply))}
    if not found:
        why = next((reply.err for reply in replies.values() if reply.err), "no robot with an engine answers")
        raise UsageError(
            f"what {short} is now, no robot could learn from its registry: {one_line(why)[:300]}", code=Code.NO_IMAGE
        )
    if len({digest for digest, _ in found.values()}) > 1:
        told = ", ".join(f"{robot} {digest}" for robot, (digest, _) in found.items())
        raise UsageError(
            f"robots disagree about {short}: {told}",
            hint="look at the registries or mirrors that they use",
            code=Code.DIGESTS,
        )
    # one that did not answer contradicts nobody either
    if others := [robot for robot in asked if robot not in found] if len(found) == 1 else []:
        say(f"what {short} is now {next(iter(found))} alone says: no registry told it to {', '.join(others)}")
    digest = next(iter(found.values()))[0]
    return digest, tuple(sorted({one for _, platforms in found.values() for one in platforms}))


def _digest(reply: Reply) -> Found | None:
    answer = mapping(reply.json()) if reply.ok else {}
    digest = string(mapping(answer.get("Descriptor")).get("digest"))
    platforms = {
        "/".join(word for key in ("os", "architecture", "variant") if (word := string(one.get(key))))
        for one in mappings(answer.get("Platforms"), most=_MOST_PLATFORMS)
    }
    plain = tuple(sorted(filter(PLATFORM.fullmatch, platforms)))
    return (digest, plain) if _DIGEST.fullmatch(digest) else None
