"""Whether a robot can still be read when it has what a plan wants: things, and words of them, each up to a number.

What robots say is read up to a length. One that has more counts as one that does not answer, for all verbs and all
instances, and an experiment needs no permission for it. So a plan that would lead there is refused. Pure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from srprov.codes import Code
from srprov.controller.robot_files import is_record_path
from srprov.errors import UsageError
from srprov.facts.model import Snapshot
from srprov.facts.placements import MOST_OF_RECORDS
from srprov.modules import MODULES, PROBING
from srprov.modules.file import FileParams
from srprov.modules.listed import listed
from srprov.modules.module import canonical
from srprov.modules.observe import MOST_OF_INSTANCE, most_of
from srprov.planning.planread import named
from srprov.resource import Observed, Resource
from srprov.untrusted import MAX_JSON_CHARACTERS

_SPARE = 50
"""Things that a run which is cut off leaves half made, and that builds leave."""
_MOST_LISTED = MAX_JSON_CHARACTERS // 2
"""Of a list of 8 MiB: what images say of their containers, and other instances, have the rest."""
_MOST_OF_RECORD = MOST_OF_RECORDS // 4
_HINT = (
    "use more robots, ship a folder in the place of many files, and put what is long into a file; or remove from the "
    "robot what is not used any more"
)


def check_room(wants: Iterable[Resource], snapshot: Snapshot, instance: str) -> None:
    """Refuse what would make a robot say more than is read of it.

    Args:
        wants: All that the plan wants.
        snapshot: The robots as they are.
        instance: The plan's.

    Raises:
        UsageError: Names the robots, and what is too much.
    """
    wanted: dict[str, list[Resource]] = {}
    for want in wants:
        wanted.setdefault(want.host, []).append(want)
    records = _records(snapshot, instance)
    wrong = []
    for robot, mine in sorted(wanted.items()):
        seen = snapshot.observed.get(robot, ())
        beyond = (*_things(mine, seen, instance), *_words(mine), *_record(mine, records.get(robot, 0)))
        wrong += [f"{robot}: {one}" for one in beyond]
    if wrong:
        message = f"robots would have more than is read of them:\n{named(wrong)}"
        raise UsageError(message, hint=_HINT, code=Code.TOO_LARGE)


def _things(mine: Sequence[Resource], seen: Sequence[Observed], instance: str) -> Iterator[str]:
    """Say of what there would be too many, also of other instances; of what is there already nothing is new."""
    there = {(one.module, one.name) for one in seen if one.module not in PROBING}
    new = {(one.module, one.name) for one in mine if one.module not in PROBING} - there
    counts = Counter(kind for kind, _ in there | new)
    for kind in sorted({kind for kind, _ in new}):
        if counts[kind] > (most := most_of(kind) - _SPARE):
            yield f"{counts[kind]} things of the kind {kind}, which are more than {most}"
    own = {(one.module, one.name) for one in seen if one.instance == instance and one.module not in PROBING}
    of_instance = own | {(kind, name) for kind, name in new if not MODULES[kind].shared}
    if of_instance > own and len(of_instance) > (most := MOST_OF_INSTANCE - _SPARE):
        yield f"{len(of_instance)} things of the instance {instance}, which are more than {most}"


def _words(mine: Sequence[Resource]) -> Iterator[str]:
    lengths: Counter[str] = Counter()
    for one in mine:
        lengths[one.module] += listed(one.name, one.params)
    for kind, length in sorted(lengths.items()):
        if length > _MOST_LISTED:
            yield f"{kind}s take {_mib(length)} MiB of its engine's list, which is more than {_mib(_MOST_LISTED)} MiB"


def _records(snapshot: Snapshot, instance: str) -> Mapping[str, int]:
    """Return robot -> characters of the records that it holds of other instances."""
    others = {
        robot: [one for name, one in held.items() if name != instance] for robot, held in snapshot.records.items()
    }
    every = {id(one): one for held in others.values() for one in held}  # all robots have the same one
    lengths = {key: len(canonical(one)) for key, one in every.items()}
    return {robot: sum(lengths[id(one)] for one in held) for robot, held in others.items()}


def _record(mine: Sequence[Resource], others: int) -> Iterator[str]:
    """Say that the record of the placement is too long, by itself or with those of other instances."""
    records = (one.params for one in mine if is_record_path(one.name) and isinstance(one.params, FileParams))
    if (length := sum(len(one.text) for one in records)) > _MOST_OF_RECORD:
        yield f"a record of {_mib(length)} MiB, which is more than {_mib(_MOST_OF_RECORD)} MiB"
    elif length and length + others > MOST_OF_RECORDS:
        yield f"{_mib(length + others)} MiB of records of instances, which is more than {_mib(MOST_OF_RECORDS)} MiB"


def _mib(length: int) -> str:
    return f"{length / (1 << 20):.4g}"
