"""A plan as text, for people and for review. Pure.

Sorted, without times or random ids, so that equal plans give equal bytes. What is asked for, and where things go, is
shown as the files say it: a stranger chooses what his secrets are, and none of them hides a line of it.
"""

from __future__ import annotations

from collections.abc import Iterator

from srprov.errors import visible
from srprov.planning.plan import Plan, Step
from srprov.planning.steptext import WORDS, Hide, step_lines


def plan_text(plan: Plan, *, commands: bool = False, hide: Hide = str) -> str:
    """Return the plan as lines. `commands` adds what each step runs, exactly, and folds no plumbing.

    `hide` takes secrets out of what may hold one: values, commands, and what robots say.
    """
    # names and causes come from robots, and must not write lines of their own
    return "\n".join(visible(line) for line in _lines(plan, commands, hide)) + "\n"


def summary(plan: Plan) -> str:
    """Return the one line that says how much changes."""
    if plan.empty:
        where = " on the robots in reach" if plan.unreachable else ""
        if not plan.unchanged:
            return f"Nothing to do{where}."
        right = "1 resource is" if plan.unchanged == 1 else f"{plan.unchanged} resources are"
        return f"Nothing to do{where}: {right} right already."
    counts = plan.counts()
    parts = [f"{counts[action.name.lower()]} {word}" for action, word in WORDS.items() if counts[action.name.lower()]]
    return f"Plan: {', '.join(parts)}; {plan.unchanged} unchanged."


def _lines(plan: Plan, commands: bool, hide: Hide) -> Iterator[str]:
    yield f"Instance {plan.instance}" + (f" (from {plan.source})" if plan.source else "")
    if plan.permissions:
        yield ""
        yield "Asks for more than its own containers (allow with --allow KIND):"
        for permission in plan.permissions:
            yield f"  ! {permission.kind:<14} {permission.service}: {permission.what}"
    if plan.secrets:
        yield ""
        yield "Secrets, read here and shown nowhere:"
        width = max(len(source.name) for source in plan.secrets)
        yield from (f"  {source.name:<{width}}  from {source.origin}" for source in plan.secrets)
    if plan.playbooks:
        yield ""
        yield "Playbooks beside srprov's own:"
        width = max(len(playbook.name) for playbook in plan.playbooks)
        yield from (f"  {playbook.name:<{width}}  {playbook.how}" for playbook in plan.playbooks)
    if plan.data:
        yield ""
        yield "Data:"
        yield from (f"  ! {move.text}" for move in plan.data)
    if plan.assignment:
        yield ""
        yield from _assignment(plan)
    by_robot: dict[str, list[Step]] = {}
    for step in plan.steps:
        by_robot.setdefault(step.host, []).append(step)
    for host, steps in sorted(by_robot.items()):
        yield ""
        yield host
        yield from step_lines(steps, commands=commands, hide=hide)
    if plan.unreachable or plan.notes:
        yield ""
    for host, reason in sorted(plan.unreachable.items()):
        first, *hints = reason.split("\n")  # no other character ends a line: what a robot said is in the first one
        yield f"unreachable: {host}: {hide(visible(first))}"
        if words := " ".join(" ".join(hints).split()):  # in a plan file it may be any text: it gets one line
            yield f"  hint: {hide(visible(words))}"
    for note in plan.notes:
        yield f"note: {note}"
    yield ""
    yield summary(plan)


def _assignment(plan: Plan) -> Iterator[str]:
    width = max(len(service) for service in plan.assignment)
    robots = max(len(robot) for robot in plan.assignment.values())
    # where nothing was to be chosen, a cost says nothing
    yield f"Placement (cost {plan.cost:.4f})" if plan.chosen else "Placement"
    for service, robot in sorted(plan.assignment.items()):
        cost = f"  cost {plan.costs[service]:.4f}" if plan.chosen and service in plan.costs else ""
        yield f"  {service:<{width}} -> {robot:<{robots}}{cost}".rstrip()
