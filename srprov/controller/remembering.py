"""What a run leaves in this machine's memory: which robots hold which placement record because it put it there.

Takes a `Planned` and what came of it; reads and writes the memory of its instance. The next plan believes these robots.
"""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING

from srprov.controller.ownership import strangers
from srprov.controller.robot_files import record_path
from srprov.record.memory import Memory, built_for, digest, note_images, recall, remember
from srprov.untrusted import mapping, parse_json

if TYPE_CHECKING:
    from srprov.controller.plan import Planned
    from srprov.execution import RunResult
    from srprov.session import Session


def begin(planned: Planned, sessions: Mapping[str, Session]) -> str:
    """Remember, before the first act, what robots may have from now on; return why that is not possible, or nothing."""
    before, given = recall(planned.plan.instance), dict(_given(planned))
    if not given:
        return ""
    records = tuple(dict.fromkeys((*before.records[-1:], *given.values())))
    robots = before.robots | given.keys()
    return remember(planned.plan.instance, _of(robots, records, before, sessions, given))


def end(planned: Planned, result: RunResult, verb: str, sessions: Mapping[str, Session]) -> str:
    """Remember what robots have after a run that did all that it should; after any other, `begin` still holds."""
    instance, given = planned.plan.instance, dict(_given(planned))
    if result.exit_code or verb == "build":  # it places nothing
        return ""
    before = recall(instance)
    away = before.robots & result.unreachable.keys()  # what was given to them, they still have
    if verb == "destroy":
        kept = away | _not_asked(planned, before)
        return remember(instance, _of(kept, before.records, before, sessions, ()))
    if not planned.desired:
        return ""  # a plan from a file names only what it changes
    records = tuple(dict.fromkeys((*(before.records if away else ()), *given.values())))
    return remember(instance, _of(away | given.keys(), records, before, sessions, given))


def _not_asked(planned: Planned, before: Memory) -> frozenset[str]:
    """Return the robots that still have what they were given, as nothing was taken from them: others were chosen.

    Forgotten, they would be believed no more than one that lies: what it says of the instance would be as good.
    """
    if planned.snapshot is None:
        return frozenset()
    asked = planned.snapshot.facts.keys() - strangers(planned.snapshot, before)
    return before.robots - (asked.intersection(planned.limit) if planned.limit else asked)


def _of(
    robots: frozenset[str], records: tuple[str, ...], before: Memory, sessions: Mapping[str, Session],
    given: Collection[str],
) -> Memory:  # fmt: skip
    """Return the memory of some robots, with what those that this run reached proved to be, and the others before."""
    proofs = {**before.proofs, **{robot: sessions[robot].identity for robot in given if robot in sessions}}
    return Memory(robots=robots, records=records, proofs={one: proofs[one] for one in sorted(robots) if one in proofs})


def note_built(result: RunResult, sessions: Mapping[str, Session]) -> str:
    """Remember the ids of images that this run had built, and who built them; return why not, or nothing."""
    built: dict[str, set[str]] = {}
    for one in result.results:
        want = one.step.want
        if want is not None and want.module == "image" and want.params.source == "build" and one.after:
            tag = built_for(want.name, next(iter(want.params.runs), ""))
            if one.step.host in sessions:
                built.setdefault(tag, set()).add(f"{one.after['id']} {sessions[one.step.host].identity}")
    return note_images(built)


def _given(planned: Planned) -> Iterator[tuple[str, str]]:
    """Return robot -> digest of the record that it is to have."""
    wanted = planned.desired or tuple(step.want for step in planned.plan.steps if step.want is not None)
    for resource in wanted:
        if resource.module == "file" and resource.name == record_path(planned.plan.instance):
            yield resource.host, _digest(resource.params.data)


@functools.lru_cache(maxsize=4)  # all robots have one
def _digest(content: bytes) -> str:
    try:
        return digest(mapping(parse_json(content.decode())))
    except ValueError:  # a plan file may hold anything
        return digest({})
