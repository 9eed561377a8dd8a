"""A run as JSON and as lines. Pure, but for the clock of `Phases`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from srprov.codes import Code
from srprov.controller.phases import Phases
from srprov.errors import indented, with_code
from srprov.execution import Outcome, RunResult, StepResult
from srprov.planning.plan import Plan, Step
from srprov.resource import Action
from srprov.session import Session

if TYPE_CHECKING:
    from srprov.images.plan import ImagePlan


def run_json(plan: Plan, result: RunResult, sessions: Mapping[str, Session], phases: Phases) -> dict[str, Any]:
    """Return the documented JSON of a run, without the folder of its record."""
    of_robots: dict[str, list[StepResult]] = {}
    for one in result.results:
        of_robots.setdefault(one.step.host, []).append(one)
    return {
        "instance": plan.instance,
        "changed": result.count(Outcome.CHANGED),
        "unchanged": result.unchanged + result.count(Outcome.UNCHANGED),
        "failed": result.count(Outcome.FAILED),
        "skipped": result.count(Outcome.SKIPPED),
        "not_reached": result.count(Outcome.NOT_REACHED) + result.count(Outcome.UNREACHABLE),
        "unreachable": sorted(result.unreachable),
        "assignment": dict(sorted(plan.assignment.items())),
        "cost": round(plan.cost, 6),
        "robots": {host: _robot_json(of_robots.get(host, ()), session) for host, session in sorted(sessions.items())},
        "phases": phases.end(),
        "duration_s": round(phases.total, 3),
        "probe": _probe_json(result),
        "run": None,
        "steps": [
            {"number": r.step.number, "id": r.step.id, "outcome": r.outcome.value, "message": r.message}
            for r in result.results
        ],
    }


def _probe_json(result: RunResult) -> dict[str, Any] | None:
    """Return what came of trying the overlay, without its pairs, which the record has; None: it was not tried."""
    if result.probed is None:
        return None
    said = result.probed.json()
    failed = sum(bool(one["failed"]) for one in said["pairs"])
    kept = {key: said[key] for key in ("ok", "duration_s", "causes", "left_out", "unreachable")}
    return {"pairs": len(said["pairs"]), "failed": failed, **kept}


def overlay_failures(result: RunResult) -> list[str]:
    """Return the lines on what of the overlay does not work, and on robots that did not take part in trying it."""
    if result.probed is None:
        return []
    from srprov.probing.document import problems

    said = result.probed.json()
    told = {one.step.service for one in result.results if one.outcome is Outcome.FAILED or _is_job(one.step)}
    said["left_out"] = {name: why for name, why in said["left_out"].items() if name not in told}
    lines = problems(said)
    failed = [] if result.probed.works else ["the overlay does not work between all robots and services:"]
    return [*failed, *lines]


def _robot_json(results: Sequence[StepResult], session: Session) -> dict[str, Any]:
    """Return what came of one robot's steps, and what was used for it."""
    traffic = session.traffic
    return {
        "changed": sum(one.outcome is Outcome.CHANGED for one in results),
        "failed": sum(one.outcome is Outcome.FAILED for one in results),
        "connections": traffic.connections,
        "round_trips": traffic.round_trips,
        "bytes_sent": traffic.bytes_sent,
        "bytes_received": traffic.bytes_received,
        "connect_s": round(traffic.connect_s, 3),
        "asked_s": round(traffic.asked_s, 3),
        "acted_s": round(traffic.acted_s, 3),
        "duration_s": round(sum(one.duration_s for one in results), 3),
    }


def failures(result: RunResult, images: Mapping[str, ImagePlan]) -> list[str]:
    """Return a line or more for every step that did not end well, and for every robot that could not be reached."""
    lines = []
    for one in result.results:
        if one.outcome not in (Outcome.CHANGED, Outcome.UNCHANGED):
            failed = one.outcome is Outcome.FAILED
            message = with_code(one.message, Code.STEP_FAILED) if failed else one.message
            # further lines may be a robot's own words
            lines.append(indented(f"{one.outcome.value}: #{one.step.number} {one.step.id}: {message}"))
            image = images.get(one.step.name)
            if image and one.outcome is Outcome.FAILED:
                from srprov.images.tag import locate_failure  # only a failed build needs it

                place = locate_failure(image, one.message)
                lines += [f"  it comes from {place}"] if place else []
    lines += [f"unreachable: {host}: {reason}" for host, reason in sorted(result.unreachable.items())]
    lines += [f"warning: {host} has no audit line: {reason}" for host, reason in sorted(result.unaudited.items())]
    return lines


def jobs_under_way(result: RunResult) -> list[str]:
    """Return a line for each job that this run started and that has not ended by now: its end is not awaited."""
    lines = []
    for one in result.results:
        step = one.step
        if one.outcome is Outcome.CHANGED and _is_job(step) and (one.after or {}).get("state") == "running":
            lines.append(
                f"{step.service} on {step.host} is a job and was started; `srprov wait` with "
                f"--until completed:{step.service} ends when it is done"
            )
    return lines


def _is_job(step: Step) -> bool:
    """Return whether a step's service is meant to end by itself."""
    return bool(getattr(step.want.params, "job", False) if step.want else step.found and step.found.state.get("job"))


def summary(document: Mapping[str, Any], result: RunResult) -> str:
    """Return the last line of a run."""
    removed = sum(one.outcome is Outcome.CHANGED and one.step.change.action is Action.DELETE for one in result.results)
    numbers = {**document, "changed": document["changed"] - removed, "removed": removed}
    named = ("changed", *(["removed"] if removed else []), "unchanged", "failed", "skipped")
    late = document["not_reached"]  # robots out of reach are among these
    counts = ", ".join(f"{numbers[key]} {key}" for key in named) + (f", {late} not reached" if late else "")
    gone = f", {len(result.unreachable)} unreachable" if result.unreachable else ""
    state = "interrupted" if result.interrupted else "done"
    name = document["instance"].removeprefix(".")  # the dot of `.images` only keeps it apart from users' names
    return f"{name}: {state} in {document['duration_s']:.1f} s: {counts}{gone}"
