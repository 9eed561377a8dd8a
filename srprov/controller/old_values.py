"""What a plan's steps change, value by value: the old ones are read from the robots, where there is something to show.

Takes steps and what was found; gives the same steps with their differences. Asks only robots on which a value changes:
one round trip, and another one where a shipped file or folder that is mounted takes the place of one. Changes nothing.

What is a secret, or looks like one, is not shown: neither the value that is there nor the one that comes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from srprov.controller.robot_files import is_record_path
from srprov.facts.gather import Gathering
from srprov.modules import MODULES
from srprov.modules.differences import HIDDEN
from srprov.modules.file import whole
from srprov.modules.tree import TreeParams, between_trees, content_difference, content_queries, mounted_tree
from srprov.planning.plan import Step
from srprov.resource import Action, Difference, Observed, Resource
from srprov.secret import MASK, redact
from srprov.snapshot import suspicion
from srprov.wire import AnyQuery, Reply

_MOST_ASKED = 256
"""Resources of one robot whose old values are read."""
_NAMED = re.compile(r"(?:environment|labels|logging|sysctls)\.(.+)", re.DOTALL)
_PROSE = ("command", "entrypoint", "healthcheck.test")
"""Fields of several words, any of which may be a secret."""
_IN_FILE = "a secret stands in it: not shown"


class _Asked(msgspec.Struct, frozen=True):
    """A step whose old values are read, and from where; a new file of srprov's own has none."""

    step: Step
    host: str
    """The robot on which the old one is: another one than the step's, when a service moves."""
    item: Observed | None
    queries: tuple[AnyQuery, ...]


def with_differences(
    steps: Sequence[Step], observed: Mapping[str, Iterable[Observed]], wanted: Iterable[Resource], look: Gathering,
    *, strange: bool = False,
) -> tuple[Step, ...]:  # fmt: skip
    """Return the steps, each with the values that it changes.

    Args:
        steps: Of a plan, in their order.
        observed: Robot -> what was found there.
        wanted: All that should be true; the content of what is shipped stands in it.
        look: Asks the robots.
        strange: Also what changes in srprov's own files, and what new ones hold. It follows from the definitions, but
            in a plan file of somebody else's it is his word: they tell services where the others are.
    """
    asked = list(_asked(steps, observed, strange=strange))
    replies = _ask(look, [(one.host, one.queries) for one in asked])
    both = zip(asked, replies, strict=True)
    found = {one.step.id: _told(one, one.step.want, said) for one, said in both if one.step.want}
    homes = {one.step.id: one.host for one in asked}
    found = _with_contents(found, homes, wanted, look)
    # no secret is in an own file, and what looks like one would hide all that changes there
    own = {one.step.id for one in asked if _is_own(one.step)}
    shown = {key: few if key in own else tuple(map(masked, few)) for key, few in found.items() if few}
    return tuple(
        replace(step, differences=shown[step.id]) if step.want and step.id in shown else step for step in steps
    )


def between(old: Resource, new: Resource, blobs: Mapping[str, bytes]) -> tuple[Difference, ...]:
    """Return which values of two wanted resources differ; `blobs` are all trees of both sides by their name."""
    found = MODULES[new.module].between(old.params, new.params)
    return tuple(masked(_between_contents(one, blobs)) for one in found)


def _between_contents(one: Difference, blobs: Mapping[str, bytes]) -> Difference:
    (before, _), (after, _) = mounted_tree(one.old), mounted_tree(one.new)
    if before in blobs and after in blobs:
        return between_trees(one.field, blobs[before], blobs[after])
    return _readable(one)


def _is_own(step: Step) -> bool:
    return MODULES[step.module].is_plumbing(step.name)


def _asked(
    steps: Sequence[Step], observed: Mapping[str, Iterable[Observed]], *, strange: bool
) -> Iterable[_Asked]:  # fmt: skip
    there = {(host, one.module, one.name): (host, one) for host, items in observed.items() for one in items}
    moved = {
        (step.module, step.name): (step.host, step.found)
        for step in steps
        if step.change.action is Action.DELETE and step.found and step.service
    }
    count: dict[str, int] = {}
    for step in steps:
        place = there.get((step.host, step.module, step.name)) or moved.get((step.module, step.name))
        is_told = strange and not is_record_path(step.name) if _is_own(step) else place is not None
        if step.want is None or not is_told:  # a record is compared with its own plan
            continue
        host, item = place or (step.host, None)
        queries = MODULES[step.module].old_queries(step.name, step.want.params, item.state) if item else ()
        count[host] = count.get(host, 0) + bool(queries)
        yield _Asked(step, host, item, queries if count[host] <= _MOST_ASKED else ())


def _told(one: _Asked, want: Resource, said: Sequence[Reply]) -> tuple[Difference, ...]:
    params, state = want.params, one.item.state if one.item else {}
    return whole(params, state, said) if _is_own(one.step) else MODULES[want.module].differences(params, state, said)


def _ask(look: Gathering, wishes: Sequence[tuple[str, Sequence[AnyQuery]]]) -> list[Sequence[Reply]]:
    """Return the replies to each wish, robot and queries; all of a robot in one round trip; none of one that failed."""
    by_robot: dict[str, list[AnyQuery]] = {}
    for host, queries in wishes:
        if queries:
            by_robot.setdefault(host, []).extend(queries)
    replies = look.ask_each(by_robot) if by_robot else {}
    answers: list[Sequence[Reply]] = []
    at: dict[str, int] = {}
    for host, queries in wishes:
        start = at.get(host, 0)
        at[host] = start + len(queries)
        answers.append(replies[host][start : at[host]] if host in replies else ())
    return answers


def _with_contents(
    found: Mapping[str, tuple[Difference, ...]], homes: Mapping[str, str], wanted: Iterable[Resource], look: Gathering
) -> dict[str, tuple[Difference, ...]]:
    """Return the differences, where a shipped tree replaces one with what differs in them."""
    blobs = {one.name: one.params.blob for one in wanted if isinstance(one.params, TreeParams)}
    places = [
        (homes[key], path)
        for key, few in found.items()
        for one in few
        if (path := _replaced_path(one, blobs)) and key in homes
    ]
    unique = list(dict.fromkeys(places))[:_MOST_ASKED]
    replies = dict(zip(unique, _ask(look, [(host, content_queries(path)) for host, path in unique]), strict=True))

    def told(key: str, one: Difference) -> Difference:
        path = _replaced_path(one, blobs)
        said = replies.get((homes[key], path), ()) if path else ()
        if not said:
            return _readable(one)
        return content_difference(one.field, path, said, blobs[mounted_tree(one.new)[0]])

    return {key: tuple(told(key, one) for one in few) for key, few in found.items()}


def _replaced_path(one: Difference, blobs: Mapping[str, bytes]) -> str:
    """Return the path on the robot of what a shipped file or folder replaces, if that was shipped too; else nothing."""
    (tree, top), (new, _) = mounted_tree(one.old), mounted_tree(one.new)
    return f"{tree}/{top}" if tree and new in blobs else ""


def _readable(one: Difference) -> Difference:
    """Return a difference in which a shipped file or folder stands by its name."""
    old, new = (f"shipped {mounted_tree(side)[1]}" if mounted_tree(side)[0] else side for side in (one.old, one.new))
    if old == new and old is not None:
        return Difference(field=one.field, note="content differs")
    return replace(one, old=old, new=new)


def masked(one: Difference) -> Difference:
    """Return a difference in which nothing is a secret that is known, or that looks like one."""
    if one.diff:
        text = "\n".join(one.diff)
        if redact(text) != text or suspicion.masked(text).count("\n") != text.count("\n"):
            return Difference(field=one.field, note=_IN_FILE)
        return replace(one, diff=tuple(suspicion.masked(line) for line in one.diff))
    if one.note:
        return replace(one, note=redact(one.note))
    name = _NAMED.fullmatch(one.field)
    sides = [side for side in (one.old, one.new) if side]
    named = name is not None and any(suspicion.secret_variable(name[1], side) for side in sides)
    if named or (one.new and redact(one.new) != one.new):
        return Difference(field=one.field, note=HIDDEN)
    prose = name is not None or one.field in _PROSE
    old, new = (_without(side, prose=prose) for side in (one.old, one.new))
    if old == new:
        return Difference(field=one.field, note=HIDDEN)
    return replace(one, old=old, new=new)


def _without(side: str | None, *, prose: bool) -> str | None:
    """Return a value of one line without what is a secret in it."""
    if side is None:
        return None
    known = redact(side)
    return suspicion.masked(known) if prose and known == side else known


def as_reviewed(live: Step, filed: Step | None) -> Step:
    """Return a step that was derived from a plan file with what the file hides of its old values, and no more.

    Whoever applies the file does not know the secrets yet by which they were hidden.
    """
    if filed is None:
        return live
    by_field = {one.field: one for one in filed.differences}
    kept = tuple(
        by_field[one.field] if one.field in by_field and _only_hides(by_field[one.field], one) else one
        for one in live.differences
    )
    return live if kept == live.differences else replace(live, differences=kept)


def _only_hides(filed: Difference, live: Difference) -> bool:
    """Return whether a difference of a file is the one that was found, but for a secret in what is replaced."""
    if filed == Difference(field=live.field, note=_IN_FILE):
        return bool(live.diff)
    return _is_masked(filed.old or "", live.old or "") and filed == replace(live, old=filed.old)


def _is_masked(text: str, whole: str) -> bool:
    """Return whether a text is another one with masks in the place of some stretches of it."""
    first, *between = text.split(MASK)
    if not between or not whole.startswith(first):
        return False
    *between, last = between
    at = len(first)
    for part in between:
        at = whole.find(part, at)
        if at < 0:
            return False
        at += len(part)
    return whole.endswith(last) and len(whole) - len(last) >= at


def without_old_lines(reviewed: Step, live: Step) -> Step:
    """Return a step of somebody else's file: what he hides of a file is shown, but for the lines that were there.

    A secret may be among those; among the others he could hide what his plan does.
    """
    shown = tuple(
        replace(now, diff=tuple(line for line in now.diff if line.startswith(("+", "@@"))))
        if one.note == _IN_FILE and now.diff
        else one
        for one, now in zip(reviewed.differences, live.differences, strict=True)
    )
    return replace(reviewed, differences=shown)
