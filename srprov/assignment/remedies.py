"""What would make a conflict go away: each is tried before it is told.

Takes a Problem that holds nothing but the services of one conflict; gives hints as words. Pure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress

from msgspec.structs import replace

from srprov.assignment import ports
from srprov.assignment.conflict import OutOfTimeError, check_time, feasible
from srprov.assignment.model import Problem, ServiceGroup
from srprov.assignment.requirements import UnmetRequirement
from srprov.definitions.model import Pool

_SHOWN = 8
"""Names in one sentence; `misses` has all of them."""
_LOOKED_AT = 40
"""Services of a conflict whose missing things are compared; the misses of all are told anyway."""
_TRIED = 12
"""Changes of a kind that are tried at most."""


def for_conflict(problem: Problem) -> list[str]:
    """Return what would help, one change each, as far as time allows; several together where no single one does."""
    helps: list[str] = []
    with suppress(OutOfTimeError):
        for kind in (_slots, _abilities, _relations, _robots, _pools):
            helps.extend(kind(problem))
    return helps or [_leave_out(problem)]


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return words as a sentence has them, cut where it gets too long."""
    shown = [*words[:_SHOWN], f"{len(words) - _SHOWN} more"] if len(words) > _SHOWN else list(words)
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} {last} {shown[-1]}"


def quoted(names: Sequence[str]) -> str:
    """Return names in quotes as a sentence has them."""
    return listed([f"'{name}'" for name in names])


def in_edf(problem: Problem, names: Iterable[str]) -> list[str]:
    """Return services as an EDF can name them: of `a-1` and `a-2`, replicas of `a`, just `a`."""
    return list(dict.fromkeys(problem.services[name].instance_of or name for name in names))


def _leave_out(problem: Problem) -> str:
    names = [name for node in problem.nodes for name in node]
    alone = in_edf(problem, names)
    several = [name for name in alone if name not in problem.services]
    fewer = f"lower 'replicas' of {quoted(several)}" if several else ""
    if len(alone) == 1:
        return fewer or f"leave out {quoted(alone)}"
    return f"leave out one of {quoted(alone)}" + (f", or {fewer}" if fewer else "")


def _slots(problem: Problem) -> Iterator[str]:
    """Name the robots of which one more slot would do."""
    able = [frozenset(problem.eligible(node)) for node in problem.nodes]
    robots = sorted(frozenset().union(*able))
    alike = {robot: tuple(robot in some for some in able) for robot in robots}
    tried: dict[tuple[bool, ...], bool] = {}
    found = []
    for robot in robots:
        if alike[robot] not in tried and len(tried) < _TRIED:
            tried[alike[robot]] = feasible(_one_more_slot(problem, robot))
        if tried.get(alike[robot]):
            found.append(robot)
    if found:
        yield f"give {listed(found, 'or')} one more slot (srprov_slots in the inventory)"


def _one_more_slot(problem: Problem, robot: str) -> Problem:
    slots = {**problem.slots, robot: problem.slots[robot] + 1}
    loads = {**problem.loads, robot: (*problem.loads[robot], problem.loads[robot][-1])}
    return replace(problem, slots=slots, loads=loads)


def _robots(problem: Problem) -> Iterator[str]:
    """Say that one more robot would do, where services must run on different ones."""
    names = {name for node in problem.nodes for name in node}
    if not problem.loads or not any(len(names & set(group)) > 1 for group in problem.anti_affinity):
        return
    new, some = "", next(iter(problem.loads.values()))
    bit = 1 << len(problem.loads)
    more = replace(
        problem,
        robots=(*problem.robots, new),
        slots={**problem.slots, new: 1},
        loads={**problem.loads, new: some},
        capable={name: row if problem.services[name].robot else row | bit for name, row in problem.capable.items()},
    )
    if feasible(more):
        anywhere = sorted(name for name in names if not problem.services[name].robot)
        yield f"add one more robot that can run {quoted(in_edf(problem, anywhere))}"


def _abilities(problem: Problem) -> Iterator[str]:
    """Name the robot that lacks least of what would make one more robot do; first one where a pin wants data."""
    pairs = sorted(
        (
            sum(miss.count for miss in lacks),
            not _awaits_data(problem, node, robot),
            robot,
            node,
        )
        for node in problem.nodes[:_LOOKED_AT]
        for robot in problem.robots
        if problem.slots.get(robot, 1) and (lacks := _lacks(problem, node, robot))
        if robot in problem.loads or all(problem.services[name].robot in (None, "", robot) for name in node)
    )
    for _, _, robot, node in pairs[:_TRIED]:
        if robot not in problem.loads or feasible(_able(problem, node, robot)):
            what = " and ".join(dict.fromkeys(miss.remedy for miss in _lacks(problem, node, robot)))
            yield f"{what}, so that {robot} can run {quoted(in_edf(problem, node))}"
            return


def _awaits_data(problem: Problem, node: ServiceGroup, robot: str) -> bool:
    """Return whether a pin sends services to a robot, and data of others among them is elsewhere."""
    some = [problem.services[name] for name in node]
    return any(one.robot == robot for one in some) and any(one.data_on not in ("", robot) for one in some)


def _lacks(problem: Problem, node: ServiceGroup, robot: str) -> tuple[UnmetRequirement, ...]:
    """Return all that a robot lacks for a node, each remedy once (members repeat what their group lacks)."""
    return tuple({miss.remedy: miss for name in node for miss in problem.misses[name].get(robot, ())}.values())


def _able(problem: Problem, node: ServiceGroup, robot: str) -> Problem:
    bit = 1 << list(problem.loads).index(robot)
    return replace(problem, capable={**problem.capable, **{name: problem.capable[name] | bit for name in node}})


def _relations(problem: Problem) -> Iterator[str]:
    """Name groups that stand in the way."""
    names = {name for node in problem.nodes for name in node}
    parts_of = {group: tuple(sorted(names & set(group))) for group in problem.anti_affinity}
    times = Counter(parts_of.values())
    for group, part in parts_of.items():
        check_time()
        if len(part) < 2 or times[part] > 1:  # where two say the same, neither is what is in the way
            continue
        rest = tuple(other for other in problem.anti_affinity if other != group)
        if feasible(replace(problem, anti_affinity=rest)):
            named = quoted(in_edf(problem, part))
            if group in problem.ports:
                common = ports.shared(problem.services[name] for name in part)
                yield f"publish {listed(common)} of {named} once at most"
            else:
                yield f"take {named} out of relations.different_robot"
    for node in problem.nodes:
        parts = tuple(sorted((*(other for other in problem.nodes if other != node), *((name,) for name in node))))
        if len(node) > 1 and feasible(replace(problem, nodes=parts)):
            if volumes := _shared(problem, node):
                yield f"give each of {quoted(in_edf(problem, node))} a volume of its own, they share {quoted(volumes)}"
            else:
                yield f"take {quoted(in_edf(problem, node))} out of relations.same_robot"


def _shared(problem: Problem, node: ServiceGroup) -> list[str]:
    """Return the volumes for whose sake services are together."""
    mounts = [{mount.source for mount in problem.services[name].runtime.mounts if mount.kind == "volume"}
              for name in node]  # fmt: skip
    return sorted({one for index, some in enumerate(mounts) for other in mounts[:index] for one in some & other})


def _pools(problem: Problem) -> Iterator[str]:
    """Name two nodes that a pool would let share a slot."""
    tries = 0
    able = [set(problem.eligible(node)) for node in problem.nodes[:_LOOKED_AT]]
    for index, first in enumerate(problem.nodes[:_LOOKED_AT]):
        for later, second in enumerate(problem.nodes[index + 1 : _LOOKED_AT], index + 1):
            if tries == _TRIED or not able[index] & able[later]:
                continue
            tries += 1
            names = in_edf(problem, sorted((first[0], second[0])))
            members = _instances(problem, names)
            if members and feasible(replace(problem, pools=(*problem.pools, Pool(name="", services=members)))):
                yield f"pool {listed(names)} (pools in the EDF), they then share one slot"
                return


def _instances(problem: Problem, names: Sequence[str]) -> tuple[str, ...]:
    """Return all that a pool of these services of the EDF would hold; nothing when that reaches beyond the conflict."""
    members = {name for name, one in problem.services.items() if (one.instance_of or name) in names}
    decided = {name for node in problem.nodes for name in node}
    return tuple(sorted(members)) if members <= decided and len(names) > 1 else ()
