"""The steps of a plan as lines: each with its cause and the values that it changes; plumbing folded away. Pure."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias

from srprov.errors import visible
from srprov.modules import MODULES
from srprov.modules.differences import line_diff
from srprov.planning.plan import Step
from srprov.resource import Action, Difference

Hide: TypeAlias = Callable[[str], str]
"""Takes secrets out of a text that may hold one."""
WORDS = {
    Action.CREATE: "to add",
    Action.UPDATE: "to change",
    Action.REPLACE: "to replace",
    Action.DELETE: "to remove",
    Action.RUN: "to run",
}
NOT_SET = "(not set)"
_LONGEST = 160
"""Characters of a value in a line."""
_BARE = re.compile(r"[!-~](?:[ -~]*[!-~])?")


def is_plumbing(step: Step) -> bool:
    """Return whether a step is about what srprov makes for itself, and loses nothing; and nothing is told of it."""
    return MODULES[step.module].is_plumbing(step.name) and not (step.change.destructive or step.differences)


def step_lines(steps: Sequence[Step], *, commands: bool, hide: Hide) -> Iterator[str]:
    """Return the lines of one robot's steps. `commands` adds what each runs, exactly, and folds nothing."""
    folded = [] if commands else [step for step in steps if is_plumbing(step)]
    hidden = {step.number for step in folded}
    for step in steps:
        if step.number not in hidden:
            yield from _step(step, commands, hide)
    if folded:
        yield f"  {_symbol(folded)} {numbers([step.number for step in folded])} {own(folded)}"


def own(steps: Sequence[Step]) -> str:
    """Return in words what steps of plumbing do, e.g. `srprov's own file, vxlan: 4 to add`."""
    counts = {word: sum(step.change.action is action for step in steps) for action, word in WORDS.items()}
    parts = [f"{count} {word}" for word, count in counts.items() if count]
    return f"srprov's own {', '.join(sorted({step.module for step in steps}))}: {', '.join(parts)}"


def numbers(found: Sequence[int]) -> str:
    """Return step numbers as ranges, such as `#3, #5-#7`."""
    shown: list[str] = []
    first = last = 0
    for number in [*sorted(found), 0]:
        if number == last + 1 and last:
            last = number
            continue
        if last:
            shown.append(
                f"#{first}" if first == last else f"#{first}, #{last}" if last == first + 1 else f"#{first}-#{last}"
            )
        first = last = number
    return ", ".join(shown)


def difference_lines(one: Difference) -> Iterator[str]:
    """Return a changed value as lines: `field: old -> new`, a note, or a diff below the field's name.

    A value of several lines, such as a script in a command, is compared line by line.
    """
    field = visible(one.field)
    if one.diff:
        yield f"{field}:"
        yield from (f"  {visible(line)}" for line in one.diff)
    elif one.note:
        yield f"{field}: {visible(one.note)}"
    elif lines := line_diff(one.old or "", one.new or ""):
        yield f"{field}:"
        yield from (f"  {visible(line)}" for line in lines)
    else:
        yield f"{field}: {value(one.old)} -> {value(one.new)}"


def value(text: str | None) -> str:
    """Return a value as it stands in a line: what could be misread is in quotes, as JSON has it."""
    if text is None:
        return NOT_SET
    plain = _BARE.fullmatch(text) and text != NOT_SET and " -> " not in text
    shown = visible(text) if plain else visible(json.dumps(text, ensure_ascii=False))
    return shown if len(shown) <= _LONGEST else f"{shown[: _LONGEST - 1]}…"


def why(step: Step, hide: Hide, form: Callable[[str], str] = visible) -> str:
    """Return the cause of a step without secrets, and what it makes, which no secret of a stranger's hides."""
    return hide(form(step.change.cause)) + (f"; {form(step.makes)}" if step.makes else "")


def _symbol(steps: Sequence[Step]) -> str:
    symbols = {step.change.action.value for step in steps}
    return symbols.pop() if len(symbols) == 1 else Action.UPDATE.value


def _step(step: Step, commands: bool, hide: Hide) -> Iterator[str]:
    symbol = step.change.action.value
    after = [f"#{number}" for number in step.needs]
    after += [f"{need.id.rpartition('/')[0].split('/')[0]}'s {_short(need.id)} {need.condition}" for need in step.waits]
    needs = f"  [after {', '.join(after)}]" if after else ""
    danger = "  DATA IS LOST" if step.change.destructive else ""
    yield f"  {symbol} #{step.number} {step.module} {step.name}: {why(step, hide)}{danger}{needs}"
    for one in step.differences:
        yield from hidden_lines((f"      {line}" for line in difference_lines(one)), hide)
    for command in step.commands if commands else ():
        first, *rest = command.text().splitlines() or [""]
        lines = [f"      $ {first}", *(f"        {line}" for line in rest)]
        yield from hidden_lines(map(visible, lines), hide)


def hidden_lines(lines: Iterable[str], hide: Hide) -> list[str]:
    """Return lines that belong together without secrets, also such as have a line's end in them."""
    return hide("\n".join(lines)).split("\n")


def _short(identity: str) -> str:
    name = identity.rpartition(":")[2]
    return name.rpartition(".")[2] or name
