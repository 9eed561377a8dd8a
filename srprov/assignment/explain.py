"""Why an assignment is what it is, or why there is none: in words.

Takes a Problem without a solution, or an Assignment; gives a NoAssignment with a smallest conflict and what would
resolve it, or lines for the plan. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

from msgspec.structs import replace

from srprov.assignment import remedies
from srprov.assignment.apart import maximal
from srprov.assignment.conflict import OutOfTimeError, cut, feasible, places_needed, smallest_conflict, time_limit
from srprov.assignment.model import Assignment, Problem, ServiceGroup
from srprov.assignment.remedies import listed, quoted
from srprov.assignment.report import reasons as _reasons
from srprov.codes import Code
from srprov.errors import NoAssignment

_LONGEST_S = 2.0
"""For finding out why: every part of a conflict, and every remedy, is a search of its own."""


def no_assignment(problem: Problem) -> NoAssignment:
    """Return the error for a problem that has no solution: the conflict, what is missing, what would help."""
    # where nothing can be placed even with no relation in the way, that is quickly found out
    for one in (problem, replace(problem, anti_affinity=())):
        with suppress(OutOfTimeError), time_limit(_LONGEST_S):
            return _no_assignment(one)
    return _not_known(problem)


def _not_known(problem: Problem) -> NoAssignment:
    """Return the error where no placement was found, nor a conflict that explains it, in the time there is."""
    count = sum(len(node) for node in problem.nodes)
    message = f"no placement of {_count(count, 'service')} was found, nor in {_LONGEST_S:g} s why there is none"
    hint = "loosen different_robot, same_robot or pools, add robots, or search longer: --time-limit"
    return NoAssignment(message, hint=hint, code=Code.TOO_HARD)


def _no_assignment(problem: Problem) -> NoAssignment:
    conflict = smallest_conflict(problem)
    services = tuple(name for node in conflict for name in node)
    misses = {name: _reasons(problem, name) for name in services}
    if not problem.robots:
        return NoAssignment(
            "there is no robot to place anything on", hint="name robots in the inventory", code=Code.NO_ROBOT
        )
    if services and services[0] in problem.fixed:
        return _fixed(problem, services[0])
    if not conflict:  # there is a placement, which the search did not find in its time
        return _not_known(problem)
    alone = cut(problem, services)
    helps = remedies.for_conflict(alone)
    return NoAssignment(_message(alone, conflict), misses=misses, hint="; or ".join(helps), code=Code.NO_PLACEMENT)


def describe(assignment: Assignment) -> list[str]:
    """Return one line per service for the plan: robot, cost, runner-up; then pools, the sum, moves and notes."""
    names = max((len(name) for name in assignment.placed), default=0)
    robots = max((len(robot) for robot in assignment.placed.values()), default=0)
    lines = [
        f"{name:<{names}} -> {robot:<{robots}}  {_price(assignment, name)}"
        for name, robot in sorted(assignment.placed.items())
    ]
    lines += [f"pool {name}: {how}" for name, how in sorted(assignment.pools.items())]
    lines.append(_sum(assignment))
    lines += [f"{move.service} moves from {move.source} to {move.target}" for move in assignment.moves]
    return lines + list(assignment.notes)


def reasons(misses: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return `why_not` of an Assignment, or `misses` of a NoAssignment, as lines."""
    lines: list[str] = []
    for service, robots in sorted(misses.items()):
        lines += [f"{service} not on {robot}: {reason}" for robot, reason in sorted(robots.items())]
    return lines


def _fixed(problem: Problem, name: str) -> NoAssignment:
    """Return the error for an instance that must be on a robot which cannot run it."""
    robot = problem.fixed[name]
    lacks = problem.misses[name][robot]
    message = f"{robot} cannot run '{name}', which 'per_robot' puts there"
    helps = [
        *dict.fromkeys(miss.remedy for miss in lacks),
        f"or narrow the tags of 'per_robot', so that {robot} is out",
    ]
    return NoAssignment(message, misses={name: _reasons(problem, name)}, hint="; ".join(helps), code=Code.NO_PLACEMENT)


def _message(problem: Problem, conflict: Sequence[ServiceGroup]) -> str:
    robots = sorted({robot for node in conflict for robot in problem.eligible(node)})
    who = quoted([name for node in conflict for name in node])
    slots = sum(problem.slots[robot] for robot in robots)
    if len(conflict) == 1 and not slots:
        together = " together" if len(conflict[0]) > 1 else ""
        if robots:
            return f"{who} can run{together} only on {listed(robots)}, where no slot is left"
        return f"no robot can run {who}{together}"
    places = listed([f"{robot} ({_count(problem.slots[robot], 'slot')})" for robot in robots])
    needed = places_needed(problem)
    if needed > slots:
        pooled = " even with pools together" if needed < len(conflict) else ""
        lack = f"{_count(needed, 'place')} needed{pooled}, {slots} there"
        return f"{who} can run only on {places}: {lack}{_apart_too(problem)}"
    return f"{who} can run only on {places}, and not all of them at once{_because(problem)}"


def _apart_too(problem: Problem) -> str:
    """Name the relations that would stand in the way however many slots the robots had."""
    one_each = replace(problem, slots=dict.fromkeys(problem.slots, 1), anti_affinity=(), pools=())
    parts = [_apart(problem, group) for group in _groups(problem) if not feasible(cut(one_each, group))]
    return f"; and {'; '.join(parts)}" if parts else ""


def _groups(problem: Problem) -> list[list[str]]:
    """Return the parts of groups in `different_robot` that are to be decided."""
    names = sorted(name for node in problem.nodes for name in node)
    at = {name: index for index, name in enumerate(names)}
    # of two ports that the same services have, one is told
    ports = maximal(tuple(sorted(at[name] for name in group if name in at)) for group in problem.ports)
    told = [[names[index] for index in group] for group in ports]
    others = (sorted(at.keys() & set(group)) for group in problem.anti_affinity if group not in problem.ports)
    return [both for both in (*others, *told) if len(both) > 1]


def _apart(problem: Problem, group: Sequence[str]) -> str:
    port = next((port for names, port in problem.ports.items() if set(group) <= set(names)), "")
    if port:
        return f"{quoted(group)} {'both' if len(group) == 2 else 'all'} publish {port}"
    return f"{quoted(group)} must run on different robots"


def _because(problem: Problem) -> str:
    """Say which relations and pools take part in a conflict that is no mere lack of slots."""
    parts = [_apart(problem, group) for group in _groups(problem)]
    parts += [
        f"the pool {quoted(pool.services)} can only share a slot on a robot that can run all of it"
        for pool in problem.pools
    ]
    return f": {'; '.join(parts)}" if parts else ""


def _price(assignment: Assignment, service: str) -> str:
    terms = assignment.terms.get(service)
    if terms is None:
        return "stays: its robot cannot be reached"
    parts = f"cpu {terms.cpu:.3f}, memory {terms.memory:.3f}, swap {terms.swap:.3f}, bandwidth {terms.bandwidth:.3f}"
    runner = assignment.runner_up.get(service)
    if runner is None:
        return f"cost {terms.total:.3f} ({parts}); no other robot can"
    note = " but is full" if runner.full else ""
    return f"cost {terms.total:.3f} ({parts}); next {runner.robot} {signed(runner.difference, 3)}{note}"


def signed(number: float, digits: int) -> str:
    """Return a difference with its sign; none if it rounds to 0, as float sums differ in their last bits."""
    return f"{number:+.{digits}f}" if round(number, digits) else f"{0:.{digits}f}"


def _sum(assignment: Assignment) -> str:
    if assignment.optimal:
        return f"cost {assignment.cost:.3f}, the least possible"
    if assignment.gap:
        return f"cost {assignment.cost:.3f}; the search was stopped, {assignment.gap:.3f} less may be possible"
    return f"cost {assignment.cost:.3f}; moving running services (--reassign) would make it {assignment.least:.3f}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' if number != 1 else ''}"
