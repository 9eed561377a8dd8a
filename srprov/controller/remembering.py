"""What a run leaves in this machine's memory: which robots hold which placement record because it put it there.

Takes a `Planned` and what came of it; reads and writes the memory of its instance. The next plan believes these robots.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from srprov.controller.robot_files import record_path
from srprov.record.memory import Memory, built_for, digest, note_images, recall, remember
from srprov.untrusted import mapping, parse_json

if TYPE_CHECKING:
    from srprov.controller.plan import Planned
    from srprov.execution import RunResult
    from srprov.session import Session


def begin(planned: Planned) -> str:
    """Remember, before the first act, what robots may have from now on; return why that is not possible, or nothing."""
    before, given = recall(planned.plan.instance), dict(_given(planned))
    if not given:
        return ""
    records = tuple(dict.fromkeys((*before.records[-1:], *given.values())))
    return remember(planned.plan.instance, Memory(robots=before.robots | given.keys(), records=records))


def end(planned: Planned, result: RunResult, verb: str) -> str:
    """Remember what robots have after a run that did all that it should; after any other, `begin` still holds."""
    instance, given = planned.plan.instance, dict(_given(planned))
    if result.exit_code or verb == "build":  # it places nothing
        return ""
    before = recall(instance)
    away = before.robots & result.unreachable.keys()  # what was given to them, they still have
    if verb == "destroy":
        return remember(instance, Memory(robots=away, records=before.records))
    if not planned.desired:
        return ""  # a plan from a file names only what it changes
    records = tuple(dict.fromkeys((*(before.records if away else ()), *given.values())))
    return remember(instance, Memory(robots=away | given.keys(), records=records))


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
