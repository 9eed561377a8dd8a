"""`srprov assign`: who would run what and why; from robots, or from stored facts without any."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from srprov.cli import inputs, options
from srprov.cli.output import err, out, out_json, tell_unreachable
from srprov.cli.output_options import no_way_above
from srprov.cli.permitted import permitted
from srprov.cli.stdout_guard import answers_only
from srprov.cli.stored_facts import FACTS, stored_facts
from srprov.codes import Code
from srprov.controller.request import PlanRequest
from srprov.errors import NoAssignment, UsageError

if TYPE_CHECKING:
    from srprov.assignment.fairness import Point
    from srprov.assignment.model import Assignment, Problem


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.deciding
@options.ALLOW
@FACTS
@click.option("--explain", is_flag=True, help="Say the cost by term, the next best robot, and why not elsewhere.")
@click.option("--pareto", is_flag=True, help="Show what each step of fairness costs.")
@click.option("--svg", type=click.Path(dir_okay=False, path_type=Path), callback=no_way_above, metavar="FILE",
              help="Draw the cost matrix.")  # fmt: skip
@click.option("--png", type=click.Path(dir_okay=False, path_type=Path), callback=no_way_above, metavar="FILE",
              help="Draw the cost matrix.")  # fmt: skip
def assign(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, request: PlanRequest,
    allow: tuple[str, ...], stored: Path | None, explain: bool, pareto: bool, svg: Path | None, png: Path | None,
) -> int:  # fmt: skip
    """Show who would run what, and why; changes nothing.

    Exits with 8 when there is no placement, and says which services are in each other's way; with 4 when a robot
    cannot be reached.
    """
    allowed = permitted(allow)[1]
    definitions = inputs.load_experiment(file, request.profiles, allowed)
    inventory = inputs.load_inventory(inventories)
    if definitions.experiment.remote:
        why = "a CDF is in a git repository: what it requires of a robot is not known here"
        hint = "`srprov plan --allow git` fetches it, and shows the placement"
        raise UsageError(why, hint=hint, code=Code.REPOSITORY)
    from srprov.controller.choice import checked_choice, idle_notes, read_decided
    from srprov.controller.permissions import permit_files

    permit_files(definitions, allowed)
    before = None
    if stored:
        snapshot, decided = stored_facts(stored, inventory)
        if decided is not None:
            before, request = read_decided(decided, request)
    else:
        with inputs.connect(inventory, timeout, forks) as fleet:
            from srprov.facts.gather import Detail

            snapshot = fleet.gather(Detail.TRAFFIC)
    choice = checked_choice(definitions, inventory, snapshot, request, before)
    answer, front = _solved(choice.problem, request.search_limit_s, pareto=pareto, as_json=as_json)
    if as_json:
        from srprov.assignment.document import assign_json

        out_json(assign_json(answer, front))
    else:
        _show(answer, explain=explain, front=front)
    for note in idle_notes(definitions, choice.experiment, snapshot):
        (err if as_json else out)(note)
    for target in (svg, png):
        if target:
            _draw(answer, front, target, "svg" if target is svg else "png")
    return tell_unreachable(snapshot.unreachable)


def _solved(
    problem: Problem, seconds: float | None, *, pareto: bool, as_json: bool
) -> tuple[Assignment, tuple[Point, ...]]:
    """Return the best assignment, and with `pareto` what each step of fairness costs."""
    from srprov.assignment import fairness, solve
    from srprov.assignment.document import refusal_json

    try:
        with answers_only():
            answer = solve.solve(problem, seconds)
            front = fairness.pareto(problem, lambda one: solve.solve(one, seconds)) if pareto else ()
    except NoAssignment as error:
        if as_json:
            out_json(refusal_json(error))
        raise
    return answer, front


def _show(answer: Assignment, *, explain: bool, front: tuple[Point, ...]) -> None:
    from srprov.assignment.explain import describe, reasons, signed

    lines = describe(answer) if explain else _short(answer)
    if explain:
        lines += ["", *reasons(answer.why_not)] if any(answer.why_not.values()) else []
    if front:
        lines += ["", "FAIRNESS  COST      MORE     JAIN"]
        least = front[0].cost
        for point in front:
            more = f"{signed(100 * (point.cost / least - 1), 2)} %" if least else "-"
            lines.append(f"{point.fairness:<8g}  {point.cost:<8.3f}  {more:<7}  {point.jain:.3f}")
    out("\n".join(lines))


def _short(answer: Assignment) -> list[str]:
    width = max((len(name) for name in answer.placed), default=0)
    lines = [f"{name:<{width}} -> {robot}" for name, robot in answer.placed.items()]
    lines += [f"pool {name}: {how}" for name, how in sorted(answer.pools.items())]
    note = "the least possible" if answer.optimal else f"{answer.least:.3f} is possible"
    if answer.gap:
        note = f"the search was stopped, {answer.gap:.3f} less may be possible"
    return [*lines, f"cost {answer.cost:.3f}, {note}; Jain's index {answer.jain:.3f}"]


def _draw(answer: Assignment, front: tuple[Point, ...], target: Path, form: str) -> None:
    from srprov.cli.assign_plot import draw

    try:
        draw(answer, front, target, form)
    except OSError as error:
        raise UsageError(
            f"cannot write {target}: {error.strerror}", hint="name another file", code=Code.CANNOT_WRITE
        ) from error
