"""A plan as text, for people and for review. Pure.

Sorted, without times or random ids, so that equal plans give equal bytes.
"""

from __future__ import annotations

from collections.abc import Iterator

from srprov.errors import visible
from srprov.planning.plan import Plan, Step
from srprov.resource import Action

_WORDS = {
    Action.CREATE: "to add",
    Action.UPDATE: "to change",
    Action.REPLACE: "to replace",
    Action.DELETE: "to remove",
    Action.RUN: "to run",
}


def plan_text(plan: Plan, *, commands: bool = False) -> str:
    """Return the plan as lines. `commands` adds what each step runs, exactly."""
    # names and causes come from robots, and must not write lines of their own
    return "\n".join(visible(line) for line in _lines(plan, commands)) + "\n"


def summary(plan: Plan) -> str:
    """Return the one line that says how much changes."""
    if plan.empty:
        return f"Nothing to do: {plan.unchanged} resources are right already."
    counts = plan.counts()
    parts = [f"{counts[action.name.lower()]} {word}" for action, word in _WORDS.items() if counts[action.name.lower()]]
    return f"Plan: {', '.join(parts)}; {plan.unchanged} unchanged."


def _lines(plan: Plan, commands: bool) -> Iterator[str]:
    yield f"Instance {plan.instance} (from {plan.source})"
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
    for host in sorted({step.host for step in plan.steps}):
        yield ""
        yield host
        for step in plan.steps:
            if step.host == host:
                yield from _step(step, commands)
    if plan.unreachable or plan.notes:
        yield ""
    for host, reason in sorted(plan.unreachable.items()):
        first, *hints = reason.splitlines() or [""]
        yield f"unreachable: {host}: {first}"
        if words := " ".join(" ".join(hints).split()):  # in a plan file it may be any text: it gets one line
            yield f"  hint: {words}"
    for note in plan.notes:
        yield f"note: {note}"
    yield ""
    yield summary(plan)


def _assignment(plan: Plan) -> Iterator[str]:
    width = max(len(service) for service in plan.assignment)
    robots = max(len(robot) for robot in plan.assignment.values())
    yield f"Placement (cost {plan.cost:.4f})"
    for service, robot in sorted(plan.assignment.items()):
        cost = f"  cost {plan.costs[service]:.4f}" if service in plan.costs else ""
        yield f"  {service:<{width}} -> {robot:<{robots}}{cost}".rstrip()


def _step(step: Step, commands: bool) -> Iterator[str]:
    symbol = step.change.action.value
    after = [f"#{number}" for number in step.needs]
    after += [f"{need.id.rpartition('/')[0].split('/')[0]}'s {_short(need.id)} {need.condition}" for need in step.waits]
    needs = f"  [after {', '.join(after)}]" if after else ""
    danger = "  DATA IS LOST" if step.change.destructive else ""
    yield f"  {symbol} #{step.number} {step.module} {step.name}: {step.change.cause}{danger}{needs}"
    if commands:
        for command in step.commands:
            first, *rest = command.text().splitlines() or [""]
            yield f"      $ {first}"
            for line in rest:
                yield f"        {line}"


def _short(identity: str) -> str:
    name = identity.rpartition(":")[2]
    return name.rpartition(".")[2] or name
