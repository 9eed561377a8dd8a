"""A run of trials from its beginning, or gone on with: locks, what is there over all trials, the journal, the trials.

Takes a `Planned`, the fleet and what the user asks for; gives a `TrialsReport`. A run is gone on with only as the same
experiment: the journal's first event says what must not have changed.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import re
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

from msgspec.structs import replace

from srprov import __version__
from srprov.codes import Code
from srprov.controller.data_owner import remember_owner
from srprov.controller.fleet import Fleet
from srprov.controller.input_files import InputFile
from srprov.controller.phases import Phases
from srprov.controller.run import run
from srprov.controller.trial_connections import LockedRobots
from srprov.controller.trial_folder import check_new, check_own, make_folder, of_runs, opened
from srprov.controller.trial_history import ACCEPT, History, read_history
from srprov.controller.trial_images import remember
from srprov.controller.trial_others import refuse_others
from srprov.controller.trial_plan import TrialPlan
from srprov.controller.trial_record import keep_session, session_files
from srprov.controller.trial_report import TrialsReport
from srprov.controller.trial_request import BY_HAND, TrialsRequest
from srprov.controller.trial_sameness import Sameness, as_far_as_known, containers_of, differences, sameness
from srprov.controller.trials import Say, TrialRun, Trials
from srprov.definitions.model import Experiment, Inventory
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import RefusedError, UsageError, did_you_mean
from srprov.execution import Listener, RunOptions
from srprov.execution.lock_set import LockSet, lock_options
from srprov.execution.locks import claim
from srprov.execution.trial_at_once import at_once
from srprov.execution.trial_robots import Connections
from srprov.facts.model import Snapshot
from srprov.modules.image import ImageModule
from srprov.record.journal import Journal
from srprov.resource import Observed
from srprov.session import Session
from srprov.trials import Design, design
from srprov.trials.marks import RERUN, discarded

_FINAL = ("trials: seed", "trials: order", "trials: design", "trials: paired_seeds", "parameters: ")
"""Differences that nobody can accept: a trial's id, seed or place would mean something else."""

_NAME = re.compile(r"[0-9]{8}T[0-9]{6}Z-[A-Za-z0-9._-]{1,100}-[0-9a-f]{8}")
"""Of a run, as `_folder` makes it."""


def chosen(made: Design, only: Collection[str]) -> Design:
    """Return the design with only some trials or points.

    Raises:
        UsageError: One of them is not in it.
    """
    if not only:
        return made
    known = {one.id for one in made.points} | {one.id for one in made.trials}
    for name in only:
        if name not in known:
            hint = f"{did_you_mean(name, known)} `srprov trials FILE` lists them".strip()
            raise UsageError(f"there is no trial or point '{name[:60]}'", hint=hint, code=Code.NO_SUCH_NAME)
    trials = tuple(one for one in made.trials if one.id in only or one.point.id in only)
    return replace(made, trials=trials)


def check_request(experiment: Experiment, request: TrialsRequest) -> None:
    """Refuse what cannot be run or kept, before any robot is asked.

    Raises:
        UsageError: No trial is left or there are too many, an unknown one is asked for, or the folder cannot be used.
        RefusedError: The folder of the run to go on with may be others'.
    """
    whole = design(experiment.trials or TrialDefinitions())
    chosen(whole, request.discard)
    chosen(chosen(whole, request.only), request.rerun)
    if request.resume:
        _resumed(request)
    else:
        check_new(request.folder or of_runs() / "new")


def run_trials(
    plan: TrialPlan, fleet: Fleet, request: TrialsRequest, options: RunOptions, listener: Listener,
    say: Say, stop: threading.Event, pause: Callable[[float, str], None],
) -> TrialsReport:  # fmt: skip
    """Run all trials, on robots that are locked from the first act to the last.

    Raises:
        LockHeld: Somebody else holds one of the robots; nothing was changed.
        RefusedError: The run in the folder is of another experiment; or a trial's container is somebody else's by now.
        UsageError: The folder cannot be used, or a file of the experiment is not any more what was planned.
        OSError: It cannot be written any more; the trial under way is lost.
    """
    assert plan.base.snapshot is not None  # of a plan that was made, not read from a file
    robots = {one.host for one in plan.services} | {step.host for step in plan.base.plan.steps}
    sessions = fleet.connected()
    if away := min(robots - sessions.keys(), default=""):  # before it is compared: nothing is known of such a robot
        told = f"{away} cannot be reached, and trials run there"
        raise UsageError(told, hint="see `srprov doctor`", code=Code.NEEDED_ROBOT)
    facts = _robots(plan.base.snapshot)
    same = sameness(plan, facts, plan.base.snapshot.observed)
    folder, earlier = _folder(plan, same, request)
    files, made = session_files(plan), chosen(design(plan.given), request.only)
    fleet.sessions.prepare(sorted(robots))
    mine, waiting = claim(f"run {plan.base.plan.instance}", earlier.name), lock_options(plan.base.plan, options)
    with LockSet(robots, sessions, mine, waiting, stop, listener).acquire() as locks:
        refuse_others(plan, sessions)
        remember_owner(plan.base.plan, plan.base.owner)  # also where all that the trials need is there already
        due, how = plan.base.plan.steps and not stop.is_set(), replace(options, verb="run")
        base = run(plan.base, fleet, how, Phases(), listener, stop, held=locks) if due else None
        if base is not None:
            if base.result.exit_code:
                return TrialsReport(folder=folder, rows=earlier.rows, design=made, ended_early="", base=base)
            same = sameness(plan, facts, _images(plan, sessions))  # some may have come only now
            _refuse_changes(folder, earlier, same, request)
        if not earlier.events:
            make_folder(folder)
        with LockedRobots(fleet, sessions, mine, waiting) as locked, opened(folder) as place:
            forgetful = remember(place, plan, same, sessions, fleet.inventory)
            trials = _all(
                plan, files, fleet.inventory, made, same, place, earlier, request, locked, options, say, stop, pause,
            )  # fmt: skip
    return TrialsReport(
        folder=folder, rows=trials.rows, design=made, ended_early=trials.ended_early, base=base,
        discarded=trials.discarded, forgetful=forgetful,
    )  # fmt: skip


def _all(
    plan: TrialPlan, files: Mapping[str, InputFile], inventory: Inventory, made: Design, same: Mapping[str, str],
    folder: Path, earlier: History, request: TrialsRequest, connections: Connections, options: RunOptions, say: Say,
    stop: threading.Event, pause: Callable[[float, str], None],
) -> Trials:  # fmt: skip
    """Run what has not ended yet, with the journal open."""
    with Journal(folder, earlier.events + 1) as journal:
        keep_session(folder, earlier.sessions + 1, plan, inventory, files)
        begun = {"version": __version__, "run": earlier.name, "same": same}
        journal.add("resume" if earlier.events else "run", **begun, trials=len(made.trials))
        earlier = _changed(journal, earlier, request, same, made)
        about = TrialRun(
            plan=plan,
            whole=design(plan.given),
            design=made,
            folder=folder,
            name=earlier.name,
            stop_limit_s=options.stop_timeout_s,
            rows=earlier.rows,
            begun=earlier.begun,
            lost=earlier.lost,
            segment=earlier.segment,
            discarded=earlier.discarded,
        )
        trials = Trials(about, connections, journal, say)
        trials.settle_lost()
        trials.tables.write()
        if not trials.ended_early:
            trials.all(stop, pause)
        journal.add("ended", reason=trials.ended_early)
    return trials


def _changed(
    journal: Journal, earlier: History, request: TrialsRequest, same: Mapping[str, str], made: Design
) -> History:
    """Write down which trials are run again, and which changes were accepted; return the history after that."""
    again = {one.id for one in chosen(made, request.rerun).trials} if request.rerun else set()
    reason = request.reason or BY_HAND
    for trial in sorted(again):
        journal.add(RERUN, trial=trial, reason=reason)
    rows = tuple(discarded(earlier.rows, again, reason))
    if earlier.events and (changes := differences(earlier.same, same)):
        journal.add(ACCEPT, same=same, changes=changes)
        earlier = replace(earlier, segment=earlier.segment + 1)
    return replace(earlier, rows=rows, discarded=earlier.discarded - again)


def _robots(snapshot: Snapshot) -> dict[str, dict[str, str]]:
    return {
        name: {
            "hostname": one.hostname,
            "arch": one.arch,
            "kernel": one.kernel,
            "docker": one.docker.version if one.docker else "",
        }
        for name, one in snapshot.facts.items()
    }


def _images(plan: TrialPlan, sessions: Mapping[str, Session]) -> dict[str, Sequence[Observed]]:
    """Return the images on each robot of a trial's container, as they are now."""
    images = ImageModule()
    hosts = sorted({one.host for one in containers_of(plan)})
    return at_once(hosts, lambda host: images.parse(sessions[host].ask(images.queries())), threading.Event())


def _folder(plan: TrialPlan, same: Mapping[str, str], request: TrialsRequest) -> tuple[Path, History]:
    """Return the run's folder, new or with what it says of an earlier session."""
    if not request.resume:
        now = dt.datetime.now(dt.timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        digest = hashlib.sha256(json.dumps(dict(same), sort_keys=True).encode()).hexdigest()[:8]
        name = f"{now}-{plan.base.plan.instance}-{digest}"
        folder = request.folder or of_runs() / name
        check_new(folder)
        return folder, History(name=name)
    folder, earlier = _resumed(request)
    _refuse_changes(folder, earlier, as_far_as_known(same, earlier.same), request)
    return folder, earlier


def _refuse_changes(folder: Path, earlier: History, same: Sameness, request: TrialsRequest) -> None:
    """Refuse to go on with what is another experiment by now; a new run has nothing to be compared with."""
    changed = differences(earlier.same, same) if earlier.events else ()
    final = any(one.startswith(_FINAL) for one in changed)
    if changed and (final or not request.accept_changes):
        lines = "\n".join(f"  {one}" for one in changed)
        hint = "run it as it was, or begin a new run in another folder"
        hint += "" if final else "; --accept-changes goes on all the same"
        raise RefusedError(
            f"this is not the experiment of {folder} any more:\n{lines}", hint=hint, code=Code.EXPERIMENT_CHANGED
        )


def _resumed(request: TrialsRequest) -> tuple[Path, History]:
    """Return the folder of the run that is gone on with, and what happened in it."""
    if request.folder is None:
        raise UsageError("--resume goes on with the run in a folder", hint="name it with -o DIR", code=Code.OPTIONS)
    check_own(request.folder)
    found = read_history(request.folder)
    if not _NAME.fullmatch(found.name):  # containers are told it, and a colleague may have given the folder
        raise UsageError(
            f"{request.folder}: its run has a name that none has", hint="begin a new run", code=Code.RECORD
        )
    return request.folder, found
