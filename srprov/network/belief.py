"""Whose placement record is believed: a robot speaks for itself, and for others only where a run gave it the words.

Takes all robots as they are, and the robots and the records of this machine's last run; gives a `Belief`. Pure.

| of the robots of this machine's last run                    | what counts                                       |
|-------------------------------------------------------------|---------------------------------------------------|
| one still has the record that it was given                  | that record                                       |
| all answer, and more than half hold one: somebody was there | that record, but for what is said right below     |
| anything else, or there was no run                          | of each robot's record, what it says of the robot |

So no robot can move what others are sent, by a record of its own with a higher serial, nor by cutting others off. A
robot that has none any more, as somebody ended the instance there, is no voice for one that says anything. And where
that run gave a record to one robot alone, that one would be more than half: what this machine did not write, and no
other robot holds, counts only where it speaks of nobody else.

A run that did not come to its end leaves two records of this machine's that robots may have. Where none that answers
has the newer one, the older one counts, as that run may have written nothing; but for who sends something to a service
it is not enough while a robot that was given a record is silent: root on one may keep the older one on purpose.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from typing import Any

import msgspec

from srprov.facts.model import Snapshot

Record = Mapping[str, Any]


class Belief(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of an instance's last placement."""

    record: Record | None = None
    """What counts without anybody's consent."""
    claimed: Record | None = None
    """What counts when the user says that it may: the record that most robots hold."""
    holders: frozenset[str] = frozenset()
    """Robots that hold the record that was taken."""
    disputes: tuple[str, ...] = ()
    """Why `claimed` may be wrong, in words: robots that contradict each other, or that nobody can confirm."""
    unsure: tuple[str, ...] = ()
    """Robots that may have a newer record of this machine's than `record`: they were given one, and it is not that."""
    absent: tuple[str, ...] = ()
    """What `claimed` says of robots that cannot be asked, in words."""
    notes: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """What `claimed` says beyond `record`, in words."""
        return (*self.disputes, *self.absent)


def believe(
    instance: str, snapshot: Snapshot, keepers: Collection[str], written: Callable[[Record], int] = lambda _record: -1,
    newest: int = -1,
) -> Belief:  # fmt: skip
    """Return what is believed of an instance's records.

    Args:
        instance: The instance's id.
        snapshot: All robots as they are.
        keepers: The robots that this machine's last run gave a record to; empty where there was none.
        written: Tells which of the records of that run one is, the newest the highest; -1 for none of them.
        newest: What `written` tells of the newest.
    """
    held = _shared({robot: records[instance] for robot, records in snapshot.records.items() if instance in records})
    trusted = {robot: record for robot, record in held.items() if robot in keepers}
    ages = {id(record): written(record) for record in _distinct(held)}
    away = sorted(robot for robot in keepers if robot in snapshot.unreachable)
    lone = _lone(trusted, held, snapshot)
    best = _settled(trusted, len(keepers), ages, doubtful=bool(away or lone))
    if best is not None:
        holders = frozenset(robot for robot, record in held.items() if record is best)
        odd = sorted(robot for robot, record in held.items() if record is not best and ages[id(record)] < 0)
        notes = tuple(f"{robot} holds another record of this instance: it is not believed" for robot in odd)
        unsure = tuple(sorted({*keepers} - holders)) if 0 <= ages[id(best)] < newest else ()
        if unsure:
            older = f"{', '.join(sorted(holders))} ha{'ve' if len(holders) > 1 else 's'} an older record of it"
            notes += (f"{older} than a run of this machine wrote; {', '.join(unsure)} may have the newer one",)
        return Belief(record=best, claimed=best, holders=holders, unsure=unsure, notes=notes)
    if not held:
        gone = "no robot that answers holds a record of this instance"
        silent = f"{', '.join(away)}, to which a run of this machine gave one, cannot be asked what runs there"
        return Belief(notes=(f"{gone}, and {silent}",) if away else ())
    most = _most_held(held)
    holders = frozenset(robot for robot, record in held.items() if record is most)
    disputes = _differing(held, most)
    if keepers:
        few = f"no record is on more than half of {', '.join(sorted(keepers))}"
        why = f"{', '.join(away)} cannot be asked" if away else lone or few
        who = f"{', '.join(sorted(held))} do{'es' * (len(held) == 1)}"
        disputes.append(f"{who} not hold what this machine wrote, and {why}")
    absent = tuple(_of_others(most, holders, snapshot))
    return Belief(record=_of_own(held, most), claimed=most, holders=holders, disputes=tuple(disputes), absent=absent)


def _shared(held: Mapping[str, Record]) -> dict[str, Record]:
    """Return the records, those that are equal as one object: all robots have one, and each names all robots."""
    texts = {id(record): json.dumps(record, sort_keys=True) for record in _distinct(held)}
    first: dict[str, Record] = {}
    return {robot: first.setdefault(texts[id(record)], record) for robot, record in held.items()}


def _distinct(held: Mapping[str, Record]) -> list[Record]:
    """Return the objects, each once."""
    return list({id(one): one for one in held.values()}.values())


def _settled(trusted: Mapping[str, Record], given: int, ages: Mapping[int, int], *, doubtful: bool) -> Record | None:
    """Return the record that needs nobody's consent: this machine's, or one that most of the `given` robots hold.

    None: there is none; or it is not this machine's, and `doubtful`.
    """
    ours = max(trusted.values(), key=lambda record: ages[id(record)], default=None)
    if ours is None or ages[id(ours)] >= 0:
        return ours
    most = _most_held(trusted)
    agree = 2 * sum(record is most for record in trusted.values()) > given
    return most if agree and not doubtful else None


def _lone(trusted: Mapping[str, Record], held: Mapping[str, Record], snapshot: Snapshot) -> str:
    """Say that one robot alone holds what the trusted ones do, and that it speaks of others here; or nothing."""
    most = _most_held(trusted) if trusted else {}
    holders = {robot for robot, record in held.items() if record is most}
    if len(holders) != 1:
        return ""
    named = {*most.get("robots", {}), *(entry["robot"] for entry in most.get("services", {}).values())}
    others = sorted((named - holders) & (snapshot.facts.keys() | snapshot.unreachable.keys()))
    return f"no other robot holds what {min(holders)} says of {', '.join(others)}" if others else ""


def _most_held(held: Mapping[str, Record]) -> Record:
    """Return the record that most robots hold, those first that it says anything of; of several the newest."""
    holders = Counter(map(id, held.values()))
    named = Counter(id(record) for robot, record in held.items() if robot in record.get("robots", {}))

    def weight(record: Record) -> tuple[int, int, int]:
        return named[id(record)], holders[id(record)], int(record["serial"])

    return max(held.values(), key=weight)


def _of_own(held: Mapping[str, Record], most: Record) -> Record:
    """Return what each robot's record says of the robot itself; where two have one service, `most` decides."""
    placed: dict[tuple[int, str], dict[str, Any]] = {}
    for record in _distinct(held):
        for name, entry in record.get("services", {}).items():
            placed.setdefault((id(record), entry["robot"]), {})[name] = entry
    services: dict[str, Any] = {}
    robots: dict[str, Any] = {}
    for robot, record in sorted(held.items(), key=lambda one: one[1] is most):
        services |= placed.get((id(record), robot), {})
        robots |= {robot: record["robots"][robot]} if robot in record.get("robots", {}) else {}
    return {**most, "services": services, "robots": robots}


def _differing(held: Mapping[str, Record], most: Record) -> list[str]:
    first = min(robot for robot, record in held.items() if record is most)
    return [
        f"{first} and {robot} hold different records of it (serial {most['serial']} and {record['serial']})"
        for robot, record in sorted(held.items())
        if record is not most
    ]


def _of_others(record: Record, holders: Collection[str], snapshot: Snapshot) -> list[str]:
    """Say what a record says of robots that cannot be asked."""
    away: dict[str, list[str]] = {}
    for service, entry in sorted(record.get("services", {}).items()):
        if entry["robot"] in snapshot.unreachable:
            away.setdefault(entry["robot"], []).append(service)
    who = min(holders)
    return [
        f"{who} says that {', '.join(services)} run{'s' * (len(services) == 1)} on {robot}, which cannot be reached"
        for robot, services in sorted(away.items())
    ]
