"""`srprov assign`: who would run what and why; from robots, or from stored facts without any."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from srprov.cli import options
from srprov.cli.history import HISTORY, read_history
from srprov.cli.output import err, out, out_json
from srprov.cli.stdout_guard import answers_only
from srprov.errors import DefinitionError, NoAssignment, UsageError

if TYPE_CHECKING:
    from srprov.assignment.fairness import Point
    from srprov.assignment.model import Assignment, Problem
    from srprov.controller import PlanRequest
    from srprov.definitions.model import Definitions, Inventory
    from srprov.facts.model import Snapshot

UNREACHABLE = 4


@click.command()
@click.argument("file", metavar="FILE")
@options.robots
@options.INSTANCE
@HISTORY
@click.option(
    "--facts",
    "stored",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Decide from what `facts --json` wrote; no robot is asked.",
)
@click.option("--reassign", is_flag=True, help="Let running services move when that is cheaper.")
@click.option("--explain", is_flag=True, help="Say the cost by term, the next best robot, and why not elsewhere.")
@click.option("--pareto", is_flag=True, help="Show what each step of fairness costs.")
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Stop each search after so long, with the best found; an answer takes up to three, --pareto more.",
)
@click.option("--svg", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw the cost matrix.")
@click.option("--png", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw the cost matrix.")
def assign(
    file: str, inventories: tuple[str, ...], as_json: bool, forks: int, timeout: float, instance: str,
    history: Path | None, stored: Path | None, reassign: bool, explain: bool, pareto: bool, time_limit: float | None,
    svg: Path | None, png: Path | None,
) -> int:  # fmt: skip
    """Show who would run what, and why; changes nothing.

    Exits with 8 when there is no placement, and says which services are in each other's way; with 4 when a robot
    cannot be reached.
    """
    from srprov.assignment import fairness, solve
    from srprov.assignment.document import assign_json, refusal_json
    from srprov.controller import PlanRequest
    from srprov.definitions.expand import nowhere

    definitions, inventory = options.load_experiment(file), options.load_inventory(inventories)
    wishes = PlanRequest(instance=instance, reassign=reassign, history=read_history(history), forks=forks)
    if stored:
        found = _stored(stored, inventory)
        task = _problem(definitions, inventory, found, wishes)
    else:
        with options.open_lab(inventory, timeout, forks) as lab:
            found, task = _asked(definitions, inventory, lab, wishes)
    try:
        with answers_only():
            answer = solve.solve(task, time_limit)
            front = fairness.pareto(task, lambda one: solve.solve(one, time_limit)) if pareto else ()
    except NoAssignment as error:
        if as_json:
            out_json(refusal_json(error))
        raise
    if as_json:
        out_json(assign_json(answer, front))
    else:
        _show(answer, explain=explain, front=front)
    for note in nowhere(definitions.experiment, task.services.values(), away=bool(found.unreachable)):
        (err if as_json else out)(note)
    for target in (svg, png):
        if target:
            _draw(answer, front, target, "svg" if target is svg else "png")
    for host, reason in sorted(found.unreachable.items()):
        err(f"unreachable: {host}: {reason}")
    return UNREACHABLE if found.unreachable else 0


def _stored(path: Path, inventory: Inventory) -> Snapshot:
    """Read facts from a file; robots of the inventory that it does not have count as out of reach."""
    from srprov.cli.facts_ranges import check_ranges
    from srprov.facts.host import with_inventory
    from srprov.facts.stored import parse, read_document

    try:
        document = parse(path.read_text(encoding="utf-8"))
        found = read_document(document)
        check_ranges(document["robots"])
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: {error}", hint="give a file that `srprov facts --json` wrote") from error
    hosts = inventory.hosts
    facts = {name: with_inventory(hosts[name], one) for name, one in found.facts.items() if name in hosts}
    away = {
        name: found.unreachable.get(name, "not in the stored facts") for name in inventory.hosts if name not in facts
    }
    return dataclasses.replace(found, facts=facts, observed={name: () for name in facts}, unreachable=away)


def _asked(
    definitions: Definitions, inventory: Inventory, lab: options.Lab, request: PlanRequest
) -> tuple[Snapshot, Problem]:
    from srprov.facts.gather import Detail, gather

    found = gather(inventory, lab.sessions.get, closer=Detail.TRAFFIC, forks=request.forks)
    return found, _problem(definitions, inventory, found, request)


def _problem(definitions: Definitions, inventory: Inventory, snapshot: Snapshot, request: PlanRequest) -> Problem:
    from srprov.controller import choice_of, with_instances
    from srprov.definitions.pins import unknown_pins
    from srprov.instance import previous_robots

    if unknown := unknown_pins(definitions.experiment, inventory):
        raise DefinitionError(unknown)
    previous = previous_robots(snapshot, request.instance or definitions.experiment.name)
    experiment = with_instances(definitions.experiment, snapshot, previous)
    return choice_of(experiment, definitions, inventory, snapshot, previous, request)


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
        raise UsageError(f"cannot write {target}: {error.strerror}", hint="name another file") from error
