"""A plan as Markdown, for a comment on a pull request. Pure.

Names and causes come from robots and files: whatever could end a table cell or begin markup is escaped.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.errors import visible
from srprov.planning.plan import Plan
from srprov.planning.text import summary

_MARKUP = re.compile(r"([\\`*_{}\[\]()<>#+\-!|~@&$^])")


def plan_markdown(plan: Plan) -> str:
    """Return the plan as Markdown: the summary first, the steps in a table that folds away."""
    return "\n".join(_lines(plan)) + "\n"


def escaped(text: str) -> str:
    """Return text that Markdown shows as it is, on one line."""
    return _MARKUP.sub(r"\\\1", visible(" ".join(text.split())))


def _lines(plan: Plan) -> Iterator[str]:
    yield f"### srprov plan: {escaped(plan.instance)}"
    yield ""
    yield f"**{summary(plan)}**"
    yield ""
    lost = sum(step.change.destructive for step in plan.steps)
    if lost:
        yield f"> **{lost} steps destroy data.**"
        yield ""
    for permission in plan.permissions:
        what = escaped(f"{permission.service}: {permission.what}")
        yield f"- asks for **{escaped(permission.kind)}**: {what}"
    for playbook in plan.playbooks:
        yield f"- playbook {escaped(playbook.name)}: {escaped(playbook.how)}"
    for move in plan.data:
        yield f"- **data**: {escaped(move.text)}"
    for host, reason in sorted(plan.unreachable.items()):
        yield f"- unreachable: {escaped(host)}: {escaped(reason)}"
    for note in plan.notes:
        yield f"- {escaped(note)}"
    if plan.permissions or plan.playbooks or plan.data or plan.unreachable or plan.notes:
        yield ""
    if plan.assignment:
        yield "| service | robot | cost |"
        yield "|---|---|---|"
        for service, robot in sorted(plan.assignment.items()):
            cost = f"{plan.costs[service]:.4f}" if service in plan.costs else ""
            yield f"| {escaped(service)} | {escaped(robot)} | {cost} |"
        yield ""
    if plan.steps:
        yield from _steps(plan)


def _steps(plan: Plan) -> Iterator[str]:
    yield f"<details><summary>{len(plan.steps)} steps</summary>"
    yield ""
    yield "| # | robot | | what | cause | after |"
    yield "|---|---|---|---|---|---|"
    for step in plan.steps:
        what = escaped(f"{step.module} {step.name}")
        after = ", ".join(f"{number}" for number in step.needs)
        cause = escaped(step.change.cause) + (" **data is lost**" if step.change.destructive else "")
        yield f"| {step.number} | {escaped(step.host)} | `{step.change.action.value}` | {what} | {cause} | {after} |"
    yield ""
    yield "</details>"
