"""A plan as Markdown, for a comment on a pull request. Pure.

Names, causes and values come from robots and files: whatever could end a table cell or begin markup is escaped, and
values stand in fences that none of them can end. Steps that are equal but for their robot share a row. The text stays
below what a comment may have: what does not fit is counted.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import msgspec

from srprov.errors import visible
from srprov.names import few
from srprov.planning.plan import Plan, Step
from srprov.planning.planhash import plan_hash
from srprov.planning.steptext import Hide, difference_lines, hidden_lines, is_plumbing, numbers, own, value, why
from srprov.planning.text import summary
from srprov.resource import Difference

LONGEST = 60_000
"""Characters: GitHub takes 65,536 in a comment, and whoever posts it adds some."""
_FOR_THE_END = 1_000
"""Characters that are kept for what says how much is missing."""
_MARKUP = re.compile(r"([\\`*_{}\[\]()<>#+\-!|~@&$^])")
_MOST_ROBOTS = 12
"""Names, or ranges of numbers, in a cell."""


class _Group(msgspec.Struct, frozen=True):
    """Steps that do the same on several robots."""

    steps: tuple[Step, ...]

    @property
    def first(self) -> Step:
        """One that stands for all."""
        return self.steps[0]

    @property
    def robots(self) -> str:
        """Their robots, the first few by name."""
        return few([escaped(step.host) for step in self.steps], _MOST_ROBOTS)


def plan_markdown(plan: Plan, *, commands: bool = False, hide: Hide = str) -> str:
    """Return the plan as Markdown: the summary first, then values, then all steps in a table that folds away.

    With `commands`, what srprov makes for itself has a row of its own too. `hide` is as for `plan_text`.
    """
    head = [*_head(plan, hide)]
    text = _fitted(head, LONGEST - _FOR_THE_END, "lines")
    groups = _groups(step for step in plan.steps if commands or not is_plumbing(step))
    left = LONGEST - _FOR_THE_END - len(text)
    table = _fitted(_rows(groups, hide), left * 2 // 3, "rows") if plan.steps else ""
    values = _fitted(_values(groups, hide), left - len(table), "changed values")
    folded = [] if commands else [step for step in plan.steps if is_plumbing(step)]
    return text + values + (_folding(plan, table, folded) if plan.steps else "")


def escaped(text: str) -> str:
    """Return text that Markdown shows as it is, on one line."""
    return _MARKUP.sub(r"\\\1", visible(" ".join(text.split())))


def _fitted(pieces: Iterable[str], most: int, what: str) -> str:
    """Return pieces, each of whole lines, as long as they fit, and how many of them did not."""
    shown: list[str] = []
    size = missing = 0
    for piece in pieces:
        size += len(piece) + 1
        if missing or size > most:
            missing += 1
        else:
            shown.append(f"{piece}\n")
    return "".join(shown) + (f"\n*… and {missing} more {what}: `srprov plan` shows them.*\n\n" if missing else "")


def _head(plan: Plan, hide: Hide) -> Iterator[str]:
    yield f"### srprov plan: {escaped(plan.instance)}"
    if any(step.commands for step in plan.steps):  # else there is nothing to be done, or it cannot be
        yield f"<!-- srprov-plan sha256:{plan_hash(plan)} -->"
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
        yield f"- unreachable: {escaped(host)}: {hide(escaped(reason))}"
    for note in plan.notes:
        yield f"- {escaped(note)}"
    if plan.permissions or plan.playbooks or plan.data or plan.unreachable or plan.notes:
        yield ""
    if plan.assignment:
        yield from _placement(plan)


def _placement(plan: Plan) -> Iterator[str]:
    costs = plan.costs if plan.chosen else {}
    yield "| service | robot | cost |" if costs else "| service | robot |"
    yield "|---|---|---|" if costs else "|---|---|"
    for service, robot in sorted(plan.assignment.items()):
        cost = f" {costs[service]:.4f} |" if service in costs else " |" if costs else ""
        yield f"| {escaped(service)} | {escaped(robot)} |{cost}"
    yield ""


def _groups(steps: Iterable[Step]) -> list[_Group]:
    found: dict[object, list[Step]] = {}
    for step in steps:
        change = step.change
        key = (change.action, step.module, step.name, change.cause, step.makes, change.destructive, step.differences)
        found.setdefault(key, []).append(step)
    return [_Group(tuple(few)) for few in found.values()]


def _values(groups: Iterable[_Group], hide: Hide) -> Iterator[str]:
    """Return a piece per group that changes values."""
    for group in groups:
        if group.first.differences:
            lines = [line for one in group.first.differences for line in hidden_lines(_changed(one), hide)]
            fence = "`" * max(3, 1 + max(len(run) for line in lines for run in re.findall("`*", line)))
            title = f"**{escaped(group.first.module)} {escaped(group.first.name)}** on {group.robots}"
            yield "\n".join([title, "", f"{fence}diff", *lines, fence, ""])


def _changed(one: Difference) -> Iterator[str]:
    """Return a changed value as lines that a highlighter of diffs colours."""
    if one.diff or one.note:
        first, *diff = difference_lines(one)
        yield f"! {first}"
        yield from (line[2:] for line in diff)
        return
    if one.old is not None:
        yield f"- {visible(one.field)}: {value(one.old)}"
    if one.new is not None:
        yield f"+ {visible(one.field)}: {value(one.new)}"


def _rows(groups: Iterable[_Group], hide: Hide) -> Iterator[str]:
    """Return a row per group."""
    for group in groups:
        step = group.first
        cause = why(step, hide, escaped) + (" **data is lost**" if step.change.destructive else "")
        what = escaped(f"{step.module} {step.name}")
        listed = few(numbers([one.number for one in group.steps]).replace("#", "").split(", "), _MOST_ROBOTS)
        yield f"| {listed} | {group.robots} | `{step.change.action.value}` | {what} | {cause} |"


def _folding(plan: Plan, table: str, folded: list[Step]) -> str:
    head = [f"<details><summary>{len(plan.steps)} steps</summary>", ""]
    if table:
        head += ["| # | robots | | what | cause |", "|---|---|---|---|---|", table.rstrip("\n")]
    if folded:
        robots = len({step.host for step in folded})
        head += ["", f"On {robots} robot{'s' * (robots != 1)}, {escaped(own(folded))}"]
    return "\n".join([*head, "", "</details>"]) + "\n"
