"""Why an assignment is what it is, or why there is none: in words.

Takes a Problem without a solution, or an Assignment; gives a NoAssignment with a smallest conflict, or lines for the
plan. Pure.

Source: Hall's theorem. A service that finds no place when others are placed as well as possible spans, by alternating
paths, a set of services whose robots have exactly one slot too few; no smaller part of that set is in conflict.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from srprov.assignment.model import Assignment, Miss, Node, Problem
from srprov.errors import NoAssignment

_SHOWN = 8
"""Names in one sentence; `misses` has all of them."""


def no_assignment(problem: Problem) -> NoAssignment:
    """Give the error for a problem that has no solution: the conflict, what is missing, what would help."""
    conflict = smallest_conflict(problem)
    services = tuple(name for node in conflict for name in node)
    misses = {name: why_not(problem, name) for name in services}
    if not problem.robots:
        return NoAssignment("there is no robot to place anything on", hint="name robots in the inventory")
    robots = _robots(problem, conflict)
    if not any(problem.slots[robot] for robot in robots):
        helps = _missing_least(problem, conflict, robots) or _more_slots(robots)
        return NoAssignment(_nowhere(conflict[0], robots), misses=misses, hint=_join(helps))
    slots = sum(problem.slots[robot] for robot in robots)
    places = _listed([f"{robot} ({_count(problem.slots[robot], 'slot')})" for robot in robots])
    message = f"{_quoted(services)} can run only on {places}: {_count(len(conflict), 'place')} needed, {slots} there"
    helps = [*_more_slots(robots), *_missing_least(problem, conflict, robots), *_together(problem, conflict)]
    return NoAssignment(message, misses=misses, hint=_join(helps))


def smallest_conflict(problem: Problem) -> tuple[Node, ...]:
    """Give nodes that can't all be placed though the rest can when any one is left out; empty when all can.

    Several conflicts may exist. Nodes with the fewest robots are placed first, and of the conflicts that shows, the one
    with the fewest nodes is given. (The smallest of all would be the girth of a transversal matroid, which is NP-hard
    to find.)
    """
    eligible = {node: problem.eligible(node) for node in problem.nodes}
    holds: dict[str, list[Node]] = {robot: [] for robot in problem.slots}
    conflicts: list[tuple[Node, ...]] = []
    for node in sorted(problem.nodes, key=lambda node: (len(eligible[node]), node)):
        conflict = _insert(node, eligible, holds, problem.slots)
        if conflict:
            conflicts.append(tuple(sorted(conflict)))
    return min(conflicts, key=lambda nodes: (len(nodes), nodes), default=())


def why_not(problem: Problem, service: str) -> dict[str, str]:
    """Give robot -> reason for every robot that cannot run a service."""
    return {robot: "; ".join(miss.text for miss in lacks) for robot, lacks in problem.misses[service].items()}


def describe(assignment: Assignment) -> list[str]:
    """Give one line per service for the plan: robot, cost by term, runner-up; then the sum, moves and notes."""
    names = max((len(name) for name in assignment.placed), default=0)
    robots = max((len(robot) for robot in assignment.placed.values()), default=0)
    lines = [
        f"{name:<{names}} -> {robot:<{robots}}  {_price(assignment, name)}"
        for name, robot in sorted(assignment.placed.items())
    ]
    lines.append(_sum(assignment))
    lines += [f"{move.service} moves from {move.source} to {move.target}" for move in assignment.moves]
    return lines + list(assignment.notes)


def reasons(misses: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Give `why_not` of an Assignment, or `misses` of a NoAssignment, as lines."""
    lines: list[str] = []
    for service, robots in sorted(misses.items()):
        lines += [f"{service} not on {robot}: {reason}" for robot, reason in sorted(robots.items())]
    return lines


def _insert(
    node: Node, eligible: Mapping[Node, Sequence[str]], holds: dict[str, list[Node]], slots: Mapping[str, int]
) -> list[Node]:
    """Place one more node, moving others as needed; else give the conflict: what alternating paths reach."""
    came_from: dict[str, Node] = {}
    queue = [node]  # every node is held by one robot and every robot visited once, so nothing comes twice
    for at in queue:
        for robot in eligible[at]:
            if robot in came_from:
                continue
            came_from[robot] = at
            if len(holds[robot]) < slots[robot]:
                _shift(robot, node, came_from, holds)
                return []
            queue += holds[robot]
    return queue


def _shift(robot: str, start: Node, came_from: Mapping[str, Node], holds: dict[str, list[Node]]) -> None:
    """Follow an alternating path back from a robot with a free slot, moving each node on it one robot further."""
    while True:
        node = came_from[robot]
        holds[robot].append(node)
        if node == start:
            return
        robot = next(r for r, nodes in holds.items() if node in nodes and r != robot)
        holds[robot].remove(node)


def _robots(problem: Problem, conflict: Sequence[Node]) -> tuple[str, ...]:
    """Give the robots that any node of a conflict could use, in name order."""
    return tuple(sorted({robot for node in conflict for robot in problem.eligible(node)}))


def _nowhere(node: Node, robots: Sequence[str]) -> str:
    who = _quoted(node)
    together = " together" if len(node) > 1 else ""
    if robots:
        return f"{who} can run{together} only on {_listed(robots)}, where no slot is left"
    return f"no robot can run {who}{together}"


def _missing_least(problem: Problem, conflict: Sequence[Node], robots: Sequence[str]) -> list[str]:
    """Give what would open one more robot to a service of the conflict: the pair that lacks the fewest things."""
    pairs = [
        (len(lacks), robot, node, lacks)
        for node in conflict
        for robot in problem.robots
        if robot not in robots and problem.slots.get(robot, 1) and (lacks := _node_misses(problem, node, robot))
    ]
    if not pairs:
        return []
    _, robot, node, lacks = min(pairs)
    return [f"{' and '.join(dict.fromkeys(miss.remedy for miss in lacks))}, so that {robot} can run {_quoted(node)}"]


def _node_misses(problem: Problem, node: Node, robot: str) -> tuple[Miss, ...]:
    """Give all that a robot lacks for a node, each remedy once (members repeat what their group lacks)."""
    return tuple({miss.remedy: miss for name in node for miss in problem.misses[name].get(robot, ())}.values())


def _more_slots(robots: Sequence[str]) -> list[str]:
    return [f"give {_listed(robots, 'or')} one more slot (srprov_slots in the inventory)"]


def _together(problem: Problem, conflict: Sequence[Node]) -> list[str]:
    """Give two nodes of the conflict that could share a slot by `same_robot`."""
    for i, first in enumerate(conflict):
        for second in conflict[i + 1 :]:
            if set(problem.eligible(first)) & set(problem.eligible(second)):
                return [f"put {first[0]} and {second[0]} in relations.same_robot, they then share one slot"]
    return []


def _price(assignment: Assignment, service: str) -> str:
    terms = assignment.terms.get(service)
    if terms is None:
        return "stays: its robot cannot be reached"
    parts = f"cpu {terms.cpu:.3f}, memory {terms.memory:.3f}, swap {terms.swap:.3f}, bandwidth {terms.bandwidth:.3f}"
    runner = assignment.runner_up.get(service)
    if runner is None:
        return f"cost {terms.total:.3f} ({parts}); no other robot can"
    note = " but is full" if runner.full else ""
    return f"cost {terms.total:.3f} ({parts}); next {runner.robot} {runner.difference:+.3f}{note}"


def _sum(assignment: Assignment) -> str:
    if assignment.optimal:
        return f"cost {assignment.cost:.3f}, the least possible"
    return f"cost {assignment.cost:.3f}; moving running services (--reassign) would make it {assignment.least:.3f}"


def _quoted(names: Sequence[str]) -> str:
    return _listed([f"'{name}'" for name in names])


def _listed(words: Sequence[str], last: str = "and") -> str:
    """Give words as a sentence has them, cut where it gets too long."""
    shown = [*words[:_SHOWN], f"{len(words) - _SHOWN} more"] if len(words) > _SHOWN else list(words)
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} {last} {shown[-1]}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' if number != 1 else ''}"


def _join(helps: Sequence[str]) -> str:
    return "; or ".join(helps)
