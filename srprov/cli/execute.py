"""What `apply` and `destroy` share: the question, the run with its progress, the report and the exit code."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TextIO

import click

from srprov.cli.interrupt import soft_interrupt
from srprov.cli.options import Lab
from srprov.cli.output import Answer, err, expect, out_json
from srprov.cli.output_options import is_quiet, wants_timings
from srprov.cli.progress import progress
from srprov.cli.timings import timings_text
from srprov.errors import RefusedError

if TYPE_CHECKING:
    from srprov.cli.apply import Phases
    from srprov.execution import RunOptions, RunResult
    from srprov.facts.model import Snapshot
    from srprov.images.plan import ImagePlan
    from srprov.planning.plan import Plan
    from srprov.planning.planfile import PlanFile
    from srprov.record import RunFolder
    from srprov.resource import Resource


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """A plan to carry out, with what the record keeps of how it was made."""

    plan: Plan
    file: Callable[[], PlanFile]
    snapshot: Snapshot | None = None
    assignment: object = None
    desired: tuple[Resource, ...] = ()
    images: Mapping[str, ImagePlan] = field(default_factory=dict)
    """They tell where a failed build is from."""


def confirm(made: Plan, yes: bool) -> None:
    """Ask before anything is changed, unless there is nothing to do or the user said yes."""
    if yes or made.empty:
        return
    lost = sum(step.change.destructive for step in made.steps)
    question = "Do this?" if not lost else f"Do this? {lost} steps destroy data."
    if not click.confirm(question, err=True):
        raise RefusedError("not confirmed; nothing was changed")


def carry_out(
    task: Task,
    lab: Lab,
    run_options: RunOptions,
    phases: Phases,
    *,
    as_json: bool,
    events: TextIO | None,
    color: bool,
    runs: Path | None = None,
) -> int:
    """Run the plan, show what happens, record it, report, and give the exit code."""
    from srprov import controller

    if not as_json:
        expect(Answer.ASIDE)
    made = task.plan
    lab.sessions.prepare(sorted({step.host for step in made.steps}))
    if as_json:  # the plan was not shown, and it is what says these
        for note in made.notes:
            err(f"note: {note}")
    stop = threading.Event()
    with recording(task, lab, run_options.verb, runs) as record:
        run_options = dataclasses.replace(run_options, run=record.name)
        with progress(made, record, events=events, color=color, quiet=is_quiet()) as listener, soft_interrupt(stop):
            result = controller.apply(made, lab.connected(), listener, run_options, stop)
        report = run_json(made, result, lab, phases)
        record.put_json("result.json", lambda: {**report, "run": str(record.path)})
    report["run"] = str(record.path) if record.path.is_dir() else None
    if as_json:
        out_json(report)
    for line in failures(result, task.images):
        err(line)
    if record.problem:
        err(f"warning: the record of this run is not complete: {record.problem}")
    err(summary_line(report, result))
    if wants_timings():
        err(timings_text(report["phases"], report["robots"]))
    return result.exit_code


def recording(task: Task, lab: Lab, verb: str, runs: Path | None) -> RunFolder:
    """Begin the run's folder, with everything that is known before the first act; it is written meanwhile."""
    import datetime as dt

    from srprov import __version__
    from srprov.owner import owner
    from srprov.record import RunFolder, RunInputs, default_root, run_id, write_inputs

    folder = RunFolder(runs or default_root(), run_id(task.plan, dt.datetime.now(dt.timezone.utc)))
    run = RunInputs(
        verb=verb,
        owner=owner(),
        version=__version__,
        plan=task.plan,
        file=task.file,
        inventory=lab.inventory,
        snapshot=task.snapshot,
        assignment=task.assignment,
        desired=task.desired,
    )
    write_inputs(folder, run)
    return folder


def failures(result: RunResult, images: Mapping[str, ImagePlan] = MappingProxyType({})) -> list[str]:
    """Return a line or more for every step that did not end well, and for every robot that could not be reached."""
    from srprov.execution import Outcome
    from srprov.images.tag import locate_failure

    lines = []
    for one in result.results:
        if one.outcome not in (Outcome.CHANGED, Outcome.UNCHANGED):
            lines.append(f"{one.outcome.value}: #{one.step.number} {one.step.id}: {one.message}")
            image = images.get(one.step.name) if one.step.module == "image" else None
            if image and one.outcome is Outcome.FAILED and (place := locate_failure(image, one.message)):
                lines.append(f"  it comes from {place}")
    lines += [f"unreachable: {host}: {reason}" for host, reason in sorted(result.unreachable.items())]
    lines += [f"warning: {host} has no audit line: {reason}" for host, reason in sorted(result.unaudited.items())]
    return lines


def summary_line(report: Mapping[str, Any], result: RunResult) -> str:
    """Return the last line of a run."""
    counts = ", ".join(f"{report[key]} {key}" for key in ("changed", "unchanged", "failed", "skipped"))
    gone = f", {len(result.unreachable)} unreachable" if result.unreachable else ""
    state = "interrupted" if result.interrupted else "done"
    return f"{report['instance']}: {state} in {report['duration_s']:.1f} s: {counts}{gone}"


def run_json(made: Plan, result: RunResult, lab: Lab, phases: Phases) -> dict[str, Any]:
    """Return the documented JSON of a run."""
    from srprov.execution import Outcome

    return {
        "instance": made.instance,
        "changed": result.count(Outcome.CHANGED),
        "unchanged": result.unchanged + result.count(Outcome.UNCHANGED),
        "failed": result.count(Outcome.FAILED),
        "skipped": result.count(Outcome.SKIPPED),
        "not_reached": result.count(Outcome.NOT_REACHED) + result.count(Outcome.UNREACHABLE),
        "unreachable": sorted(result.unreachable),
        "assignment": dict(sorted(made.assignment.items())),
        "cost": round(made.cost, 6),
        "robots": {
            host: {
                "changed": result.of_host(host, Outcome.CHANGED),
                "failed": result.of_host(host, Outcome.FAILED),
                "connections": session.traffic.connections,
                "round_trips": session.traffic.round_trips,
                "bytes_sent": session.traffic.bytes_sent,
                "bytes_received": session.traffic.bytes_received,
                "connect_s": round(session.traffic.connect_s, 3),
                "asked_s": round(session.traffic.asked_s, 3),
                "acted_s": round(session.traffic.acted_s, 3),
                "duration_s": round(sum(r.duration_s for r in result.results if r.step.host == host), 3),
            }
            for host, session in sorted(lab.connected().items())
        },
        "phases": phases.end(),
        "duration_s": round(phases.total, 3),
        "run": None,
        "steps": [
            {"number": r.step.number, "id": r.step.id, "outcome": r.outcome.value, "message": r.message}
            for r in result.results
        ],
    }
