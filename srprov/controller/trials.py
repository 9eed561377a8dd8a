"""Run trials one after the other, and keep all that they give.

Takes a `TrialPlan`, a `Design` and the robots' sessions, which are locked; writes the run's folder. The journal is the
truth: each table can be made from it again.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from srprov import private
from srprov.controller.trial_files import Gathered, gather_files
from srprov.controller.trial_plan import TrialPlan, containers
from srprov.controller.trial_report import in_words
from srprov.controller.trial_tables import Tables
from srprov.controller.trial_used import used
from srprov.errors import TransportError
from srprov.execution.collect import CollectFailed
from srprov.execution.trial import TrialEnd, TrialOrder, run_trial
from srprov.execution.trial_patience import EquipmentFailed, RobotRestarted
from srprov.execution.trial_robots import Connections, TrialRobots
from srprov.record.journal import Journal
from srprov.secret import redacted
from srprov.trials import Design, Trial
from srprov.trials.judge import COUNTED, End, verdict
from srprov.trials.row import Seen, row
from srprov.untrusted import mapping

Row = dict[str, object]


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialNews:
    """A moment of a trial, who is awaited in it, or how an attempt of it ended."""

    trial: str
    order: int
    """Its place, counted from 1."""
    trials: int
    values: Mapping[str, str]
    """Of its parameters."""
    what: str
    aloud: bool
    """It is worth a line of its own: more than the present state."""


Say = Callable[[TrialNews], None]


@dataclass(frozen=True, kw_only=True, slots=True)
class TrialRun:
    """What is run, and where it is kept."""

    plan: TrialPlan
    whole: Design
    design: Design
    """What is run of it now."""
    folder: Path
    name: str
    stop_limit_s: float = 60.0
    rows: tuple[Mapping[str, object], ...] = ()
    """Of attempts that ended in an earlier session of this run."""
    begun: Mapping[str, int] = field(default_factory=dict)
    """Trial -> attempts that were begun earlier, whether they ended or not."""
    lost: tuple[tuple[str, int], ...] = ()
    """Trials and attempts of them that were begun earlier and have no end."""


class Trials:
    """A run of trials under way."""

    def __init__(self, run: TrialRun, connections: Connections, journal: Journal, say: Say) -> None:
        """Take what is run, on locked robots, and whom to tell."""
        self._run, self._connections, self._journal, self._say = run, connections, journal, say
        self.rows: list[Mapping[str, object]] = list(run.rows)
        self.tables = Tables(run.folder, run.plan, run.rows)
        self._attempts = dict(run.begun)
        self._orders = {trial.id: order for order, trial in enumerate(run.whole.trials, start=1)}
        self._failures = 0
        self._told: set[tuple[str, str]] = set()
        self.ended_early = ""
        """Why the run ended before its last trial, or nothing."""

    def all(self, stop: threading.Event, pause: Callable[[float, str], None]) -> None:
        """Run every trial that has not ended yet, in order.

        Args:
            stop: Set from outside to begin no further trial.
            pause: Told to wait between two trials: seconds, and what a person is asked to do.

        Raises:
            OSError: The journal or a table cannot be written.
        """
        settings = self._run.plan.given.settings
        done = {one["trial"] for one in self.rows if one["status"] in COUNTED}
        between = False
        for trial in self._run.design.trials:
            order = self._orders[trial.id]
            if trial.id in done:
                continue
            if between and not stop.is_set():
                pause(settings.pause_s, settings.prompt)
            if stop.is_set():
                self.ended_early = "interrupted"
                return
            last = self._tried(order, trial, stop)
            between = True
            self._failures = self._failures + 1 if last["status"] == "infrastructure" else 0
            if self.ended_early:
                return
            if self._failures >= settings.max_failures:
                self.ended_early = f"the equipment failed in {self._failures} trials in a row"
            elif settings.stop_on_failure and last.get("verdict") == "failure":
                self.ended_early = "a trial's verdict is failure, and 'on_failure' is stop"
            if self.ended_early:
                return

    def note_lost(self) -> None:
        """Write down that attempts that were under way when an earlier session ended have come to nothing.

        Also those of trials that are not run now, and of trials that the design does not have any more.
        """
        trials = {trial.id: trial for trial in self._run.whole.trials}
        end = End("interrupted", "the run ended before it did")
        for name, attempt in self._run.lost:
            if trial := trials.get(name):
                self._keep(row(trial, attempt, self._orders[name], Seen(end=end)))
            else:
                self._keep({"trial": name, "attempt": attempt, "status": end.status, "reason": end.reason})

    def _keep(self, made: Row) -> Mapping[str, object]:
        """Write down how an attempt ended, without secrets, and return that."""
        kept = mapping(redacted(made))
        self._journal.add("end", trial=made["trial"], attempt=made["attempt"], row=kept)
        self.rows.append(kept)
        self.tables.add(kept)
        return kept

    def _tried(self, order: int, trial: Trial, stop: threading.Event) -> Mapping[str, object]:
        """Run a trial, and again while the equipment fails and it may be; return the last row."""
        for left in range(self._run.plan.given.settings.retries, -1, -1):
            one = self._attempt(order, trial)
            again = one["status"] == "infrastructure" and left > 0 and not stop.is_set() and not self.ended_early
            self._tell(trial, order, in_words(one) + (", trying again" if again else ""), aloud=True)
            if not again:
                return one
        raise AssertionError("a trial is tried at least once")

    def _attempt(self, order: int, trial: Trial) -> Mapping[str, object]:
        attempt = self._attempts[trial.id] = self._attempts.get(trial.id, 0) + 1
        about = {"trial": trial.id, "attempt": attempt}
        self._journal.add("begin", **about, order=order)
        made_anew = containers(self._run.plan, trial, attempt, self._run.name)
        aloud = partial(self._tell, trial, order, aloud=True)
        robots = TrialRobots(self._connections, made_anew, aloud, self._run.plan.disks)
        folder = self._run.folder / "trials" / (trial.id if attempt == 1 else f"{trial.id}.{attempt}")
        folder.mkdir(mode=0o700)  # never one that somebody else made

        def tell(moment: str) -> None:
            self._journal.add(moment, **about)
            self._tell(trial, order, moment)

        try:
            made = self._done(trial, attempt, order, robots, folder, tell)
        except BaseException:  # a full disk here, or a lock that somebody else took: nothing of ours goes on there
            with contextlib.suppress(EquipmentFailed):
                robots.clear()
            raise
        made |= used(self._run.plan, robots)
        try:
            robots.clear()
        except EquipmentFailed as error:
            made["reason"] = f"{made['reason']}; not cleared: {error}"
        kept = self._keep(made)
        private.replace_file(folder / "trial.json", json.dumps(kept, indent=2) + "\n")
        self.tables.write()
        return kept

    def _done(
        self, trial: Trial, attempt: int, order: int, robots: TrialRobots, folder: Path,
        tell: Callable[[str], None],
    ) -> Row:  # fmt: skip
        """Run an attempt and fetch what it gave; return its row."""
        plan = self._run.plan
        orders = TrialOrder(
            settings=plan.given.settings, jobs=plan.jobs, stop_limit_s=self._run.stop_limit_s, told=self._told
        )
        ended, gathered = TrialEnd(end=End("infrastructure", "")), Gathered()
        try:
            ended = run_trial(orders, robots, tell)
            begun = time.monotonic()
            gathered = gather_files(plan, ended.inspected, robots, folder)
            collect_s = time.monotonic() - begun
        except (EquipmentFailed, CollectFailed, TransportError) as error:
            if isinstance(error, RobotRestarted):
                self.ended_early = f"{error}; its network may be gone, which going on mends"
            why = error.message if isinstance(error, TransportError) else str(error)
            return row(trial, attempt, order, self._seen(ended, gathered, End("infrastructure", why)))
        except KeyboardInterrupt:
            self.ended_early = "interrupted"
            return row(trial, attempt, order, self._seen(ended, gathered, End("interrupted", "the run was ended")))
        tell("collected")
        end = ended.end
        if gathered.missing and end.status == "ok":  # who crashed could not write it, and that is data
            end = End("infrastructure", f"a required result is missing: {', '.join(gathered.missing)}")
        found = row(trial, attempt, order, self._seen(ended, gathered, end))
        success = plan.given.settings.success
        judged = verdict(success, ended.readings, gathered.matched, gathered.metrics)
        return {
            **found,
            "verdict": judged if end.status in COUNTED else "unknown",
            **{f"m_{name}": value for name, value in gathered.metrics.items()},
            "collect_s": collect_s,
            "controller_gap_s": robots.patience.gap_s,
            "files": gathered.files,
            "bytes": gathered.bytes,
        }

    def _seen(self, ended: TrialEnd, gathered: Gathered, end: End) -> Seen:
        return Seen(
            end=end,
            readings=ended.readings,
            robots={one.service: one.host for one in self._run.plan.services},
            before=ended.before,
            after=ended.after,
            began=ended.began,
            ready_s=ended.ready_s,
            duration_s=ended.duration_s,
            stop_s=ended.stop_s,
            matched=gathered.moments,
        )

    def _tell(self, trial: Trial, order: int, what: str, *, aloud: bool = False) -> None:
        count = len(self._orders)
        values = trial.point.values
        self._say(TrialNews(trial=trial.id, order=order, trials=count, values=values, what=what, aloud=aloud))
