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
from functools import partial
from pathlib import Path

import msgspec

from srprov import private
from srprov.controller.trial_adoption import adopted
from srprov.controller.trial_files import Gathered, gather_files
from srprov.controller.trial_history import LostAttempt
from srprov.controller.trial_outcome import Attempt, outcome, unjudged
from srprov.controller.trial_plan import TrialPlan, containers
from srprov.controller.trial_report import in_words
from srprov.controller.trial_used import used
from srprov.errors import TransportError
from srprov.execution.collect import CollectFailed
from srprov.execution.trial import TrialEnd, TrialOrder, run_trial
from srprov.execution.trial_patience import EquipmentFailed, RobotRestarted
from srprov.execution.trial_robots import Connections, TrialRobots
from srprov.record.journal import Journal
from srprov.record.tables import Tables
from srprov.secret import redacted
from srprov.trials import Design, Trial
from srprov.trials.judge import COUNTED, End
from srprov.trials.unwatched import NotAdopted
from srprov.untrusted import mapping

Row = dict[str, object]


class TrialNews(msgspec.Struct, frozen=True, kw_only=True):
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


class TrialRun(msgspec.Struct, frozen=True, kw_only=True):
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
    begun: Mapping[str, int] = msgspec.field(default_factory=dict)
    """Trial -> attempts that were begun earlier, whether they ended or not."""
    lost: tuple[LostAttempt, ...] = ()
    """Attempts that were begun earlier and have no end."""
    segment: int = 1
    discarded: frozenset[str] = frozenset()
    """Trials that are not run."""


class Trials:
    """A run of trials under way."""

    def __init__(self, run: TrialRun, connections: Connections, journal: Journal, say: Say) -> None:
        """Take what is run, on locked robots, and whom to tell."""
        self._run, self._connections, self._journal, self._say = run, connections, journal, say
        self.rows: list[Mapping[str, object]] = list(run.rows)
        self.tables = Tables(run.folder, run.plan.given, run.plan.robots, run.rows)
        self._attempts = dict(run.begun)
        self.discarded = run.discarded
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
        done = {one["trial"] for one in self.rows if one["status"] in COUNTED} | self.discarded
        between = False
        for trial in self._run.design.trials:
            if trial.id in done:
                continue
            if between and not stop.is_set():
                pause(settings.pause_s, settings.prompt)
            if stop.is_set():
                self.ended_early = "interrupted"
                return
            last = self._tried(trial, stop)
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

    def settle_lost(self) -> None:
        """Write down what came of attempts that were under way when an earlier session ended, and clear their robots.

        Also of trials that are not run now, and of trials that the design does not have any more.
        """
        trials = {trial.id: trial for trial in self._run.whole.trials}
        for lost in self._run.lost:
            if trial := trials.get(lost.trial):
                one = self._about(trial, lost.attempt, lost.segment)
                kept = self._keep(self._settled(one, lost), one.folder)
                self._tell(trial, in_words(kept), aloud=True)
            else:
                reason = "the run ended before it did"
                self._keep({"trial": lost.trial, "attempt": lost.attempt, "status": "interrupted", "reason": reason})
        if self._run.lost:
            try:
                self._about(self._run.whole.trials[0], 1, 1).robots.clear()
            except EquipmentFailed as error:
                self.ended_early = f"what an interrupted trial left cannot be removed: {error}"

    def _settled(self, one: Attempt, lost: LostAttempt) -> Row:
        """Return the row of an attempt whose end the journal does not have."""
        if lost.row:  # all of it was at home
            return dict(lost.row)
        try:
            if one.segment != self._run.segment:
                raise NotAdopted("the experiment was changed since")
            return adopted(one, lost)
        except NotAdopted as error:
            end = End("interrupted", f"the run ended before it did; not adopted: {error}")
            return unjudged(one, TrialEnd(end=end), Gathered(), end)

    def _about(self, trial: Trial, number: int, segment: int) -> Attempt:
        """Return an attempt with its folder, which may not be there."""
        made_anew = containers(self._run.plan, trial, number, self._run.name)
        aloud = partial(self._tell, trial, aloud=True)
        return Attempt(
            plan=self._run.plan,
            trial=trial,
            number=number,
            segment=segment,
            order=self._orders[trial.id],
            robots=TrialRobots(self._connections, made_anew, aloud, self._run.plan.disks),
            folder=self._run.folder / "trials" / (trial.id if number == 1 else f"{trial.id}.{number}"),
        )

    def _keep(self, made: Row, folder: Path | None = None) -> Mapping[str, object]:
        """Write down how an attempt ended, without secrets, also in its folder if it has one, and return that."""
        kept = mapping(redacted(made))
        self._journal.add("end", trial=made["trial"], attempt=made["attempt"], row=kept)
        self.rows.append(kept)
        self.tables.add(kept)
        if folder is not None and folder.is_dir():
            private.replace_file(folder / "trial.json", json.dumps(kept, indent=2) + "\n")
        return kept

    def _tried(self, trial: Trial, stop: threading.Event) -> Mapping[str, object]:
        """Run a trial, and again while the equipment fails and it may be; return the last row."""
        for left in range(self._run.plan.given.settings.retries, -1, -1):
            one = self._attempt(trial)
            again = one["status"] == "infrastructure" and left > 0 and not stop.is_set() and not self.ended_early
            self._tell(trial, in_words(one) + (", trying again" if again else ""), aloud=True)
            if not again:
                return one
        raise AssertionError("a trial is tried at least once")

    def _attempt(self, trial: Trial) -> Mapping[str, object]:
        number = self._attempts[trial.id] = self._attempts.get(trial.id, 0) + 1
        one = self._about(trial, number, self._run.segment)
        about = {"trial": trial.id, "attempt": number}
        self._journal.add("begin", **about, order=one.order)
        one.folder.mkdir(mode=0o700)  # never one that somebody else made

        def tell(moment: str, **more: object) -> None:
            self._journal.add(moment, **about, **more)
            self._tell(trial, moment)

        try:
            made = self._done(one, tell)
            if "verdict" in made:  # all is at home: whoever goes on needs no robot to know it
                tell("collected", row=made)
        except BaseException:  # a full disk here, or a lock that somebody else took: nothing of ours goes on there
            with contextlib.suppress(EquipmentFailed):
                one.robots.clear()
            raise
        try:
            one.robots.clear()
        except EquipmentFailed as error:
            made["reason"] = f"{made['reason']}; not cleared: {error}"
        kept = self._keep(made, one.folder)
        self.tables.write()
        return kept

    def _done(self, one: Attempt, tell: Callable[[str], None]) -> Row:
        """Run an attempt and fetch what it gave; return its row."""
        plan, ended, gathered = one.plan, TrialEnd(end=End("infrastructure", "")), Gathered()
        orders = TrialOrder(
            settings=plan.given.settings, jobs=plan.jobs, stop_limit_s=self._run.stop_limit_s, told=self._told
        )
        more: Row = {}
        try:
            ended = run_trial(orders, one.robots, tell)
            begun = time.monotonic()
            gathered = gather_files(plan, ended.inspected, one.robots, one.folder)
            more = {"collect_s": time.monotonic() - begun, "controller_gap_s": one.robots.patience.gap_s}
            made = outcome(one, ended, gathered)
        except (EquipmentFailed, CollectFailed, TransportError) as error:
            if isinstance(error, RobotRestarted):
                self.ended_early = f"{error}; its network may be gone, which going on mends"
            why = error.message if isinstance(error, TransportError) else str(error)
            made = unjudged(one, ended, gathered, End("infrastructure", why))
        except KeyboardInterrupt:
            self.ended_early = "interrupted"
            made = unjudged(one, ended, gathered, End("interrupted", "the run was ended"))
        return {**made, **more, **used(plan, one.robots)}

    def _tell(self, trial: Trial, what: str, *, aloud: bool = False) -> None:
        count, order = len(self._orders), self._orders[trial.id]
        values = trial.point.values
        self._say(TrialNews(trial=trial.id, order=order, trials=count, values=values, what=what, aloud=aloud))
