"""A run: do what the plan says, and record it.

Takes a `Planned` and the fleet; gives a `RunReport`. What came of each step is a value; nothing is raised for a robot
that fails.
"""

from __future__ import annotations

import datetime as dt
import functools
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov import __version__
from srprov.controller import remembering
from srprov.controller.data_owner import remember_owner
from srprov.controller.fleet import Fleet
from srprov.controller.input_commit import source_commit
from srprov.controller.input_files import definition_files, texts
from srprov.controller.phases import Phases
from srprov.controller.plan import Planned
from srprov.controller.report import failures, jobs_under_way, overlay_failures, run_json
from srprov.controller.saved import plan_file
from srprov.definitions.model import Inventory
from srprov.execution import Event, Listener, RunOptions, RunResult, run_plan
from srprov.execution.lock_set import LockSet
from srprov.owner import owner
from srprov.record import RunFolder, RunInputs, default_root, event_json, run_id, write_inputs
from srprov.record.folder import Sink


class RunReport(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a run, to show."""

    document: Mapping[str, Any]
    """As `schemas/run.schema.json` describes it."""
    failures: tuple[str, ...]
    """A line or more for every step that did not end well, and for every robot that could not be reached."""
    jobs: tuple[str, ...]
    """A line for every job that was started and has not ended."""
    record_problem: str
    """Why the record is not complete, or empty."""
    result: RunResult


def run(
    planned: Planned, fleet: Fleet, options: RunOptions, phases: Phases, listener: Listener, stop: threading.Event,
    *, runs: Path | None = None, held: LockSet | None = None,
) -> RunReport:  # fmt: skip
    """Lock the robots that the plan changes, do every step, and record what was given, decided and done.

    Args:
        planned: What to do, and what the record keeps of how it was made.
        fleet: The robots.
        options: Limits and deadlines.
        phases: The run's clock.
        listener: Told what happens, from several threads at once.
        stop: Set from outside to begin no further step.
        runs: Where runs are recorded; None: `~/.local/state/srprov/runs`.
        held: The locks, where the caller holds them already.

    Raises:
        UsageError: Who owns the volumes cannot be written down; nothing was changed.
        LockHeld: Somebody else holds one of the robots; nothing was changed.
    """
    remember_owner(planned.plan, planned.owner)
    fleet.sessions.prepare(sorted({step.host for step in planned.plan.steps}))
    with _recording(planned, fleet, options.verb, runs) as folder:

        def recorded(event: Event) -> None:
            folder.event(event_json(event))
            listener(event)

        forgetful = remembering.begin(planned, fleet.connected())
        options = replace(options, run=folder.name, makers=planned.makers)
        result = run_plan(planned.plan, fleet.connected(), recorded, options, stop, held)
        unnoted = remembering.note_built(result, fleet.connected())
        forgetful = unnoted or remembering.end(planned, result, options.verb, fleet.connected()) or forgetful
        document = run_json(planned.plan, result, fleet.connected(), phases)
        if result.probed is not None:
            folder.put_json("probe.json", result.probed.json)
        folder.put_json("result.json", lambda: {**document, "run": str(folder.path)})
    return RunReport(
        document={**document, "run": str(folder.path) if folder.path.is_dir() else None},
        failures=(*failures(result, planned.images), *overlay_failures(result)),
        jobs=tuple(jobs_under_way(result)),
        record_problem=folder.problem or forgetful,
        result=result,
    )


def get_ready() -> None:
    """Import what a run with changes needs, where there is time for it: it takes an eighth of a second."""
    from srprov.execution import executor  # noqa: F401 - to have it imported
    from srprov.transport.engine import preload

    preload()


def _recording(planned: Planned, fleet: Fleet, verb: str, runs: Path | None) -> RunFolder:
    """Begin the run's folder, with everything that is known before the first act; it is written meanwhile."""
    folder = RunFolder(runs or default_root(), run_id(planned.plan, dt.datetime.now(dt.timezone.utc)))
    record_inputs(folder, planned, fleet.inventory, verb)
    return folder


def record_inputs(folder: Sink, planned: Planned, inventory: Inventory, verb: str, *, with_files: bool = True) -> None:
    """Record what is known of a run before its first act, without its definition files if the caller keeps them.

    Its source's commit only where something is to be done: git takes longer than all else that then remains.
    """
    files = definition_files(planned)
    inputs = RunInputs(
        verb=verb,
        owner=owner(),
        version=__version__,
        plan=planned.plan,
        file=plan_file(planned),
        inventory=inventory,
        snapshot=planned.snapshot,
        assignment=planned.assignment,
        desired=planned.desired,
        files=(texts(files) or None) if with_files else {},
        decided=planned.decided,
    )
    changing = bool(planned.plan.steps) or verb == "run"
    write_inputs(folder, inputs, functools.partial(source_commit, planned, files) if changing else lambda: None)
