"""Walk a plan over many robots: batches in parallel, one at a time per robot, each after those that it needs.

It decides nothing: the plan says what is due and how it is done, and the modules say whether it is right. A robot that
fails is a value; the others go on. After the first interrupt, running steps end and no new one begins.
"""

from __future__ import annotations

import concurrent.futures
import itertools
import queue
import threading
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future
from contextlib import nullcontext

from srprov.errors import TransportError
from srprov.execution.audit import AuditEntry, audit
from srprov.execution.batches import Batch, Order, cut
from srprov.execution.conditions import wait_for
from srprov.execution.ending import CLOSING_S, LOOK_S, Ending
from srprov.execution.lock_set import LockSet, lock_options
from srprov.execution.locks import claim
from srprov.execution.options import RunOptions
from srprov.execution.others import refuse_others
from srprov.execution.outcome import Event, Listener, Outcome, RunResult, StepResult, ended_with, past
from srprov.execution.probe_beside import bringing_ahead, probing_beside
from srprov.execution.robot import RobotExecutor, round_trip_size
from srprov.execution.settle import settle
from srprov.execution.stopping import begins_with_stop
from srprov.execution.told import asks_others, told
from srprov.planning.plan import Plan, Step
from srprov.session import Session


def walk(
    plan: Plan, sessions: Mapping[str, Session], listener: Listener, options: RunOptions, stop: threading.Event,
    held: LockSet | None = None,
) -> RunResult:  # fmt: skip
    """Do what `srprov.execution.run_plan` promises."""
    robots = {step.host for step in plan.steps} & sessions.keys()
    mine = claim(f"{options.verb} {plan.instance}", options.run)
    unaudited: dict[str, str] = {}
    waiting = lock_options(plan, options)
    with nullcontext(held) if held else LockSet(robots, sessions, mine, waiting, stop, listener).acquire() as locks:
        reached = {host: session for host, session in sessions.items() if host not in locks.lost}
        refuse_others(plan, options.makers, reached)
        run = _Run(reached, listener, options, stop, locks.lost, plan.leads)
        with bringing_ahead(options.probing, plan.steps, reached) as brought:
            run.walk(cut(plan.steps))
        with probing_beside(options.probing, run.results.values(), reached, run.stop, listener, brought) as probing:
            results = settle(run.robots, run.results, options.settle_s, run.stop, listener)
            if options.run:
                entry = AuditEntry(run=options.run, owner=mine.owner, verb=options.verb, instance=plan.instance)
                unaudited = audit(entry, run.robots, results.values())
    ordered = tuple(results[step.number] for step in plan.steps)
    away = {one.step.host: one.message for one in ordered if one.outcome is Outcome.UNREACHABLE}
    return RunResult(
        results=ordered,
        unchanged=plan.unchanged,
        interrupted=run.stop.is_set(),
        unreachable={**away, **plan.unreachable, **run.lost},
        tolerated=options.tolerate,
        unaudited=unaudited,
        probed=probing(),
    )


class _Run:
    """One run's shared state; `results` is written by many threads, each its own steps."""

    def __init__(
        self,
        sessions: Mapping[str, Session],
        listener: Listener,
        options: RunOptions,
        stop: threading.Event,
        lost: Mapping[str, str],
        leads: Mapping[str, Mapping[str, str]],
    ) -> None:
        self.sessions, self.listener, self.options, self.stop = sessions, listener, options, stop
        most_s, may = options.stop_timeout_s, options.triggers
        self.robots = {
            host: RobotExecutor(session, listener, most_s, host in may, leads.get(host, {}))
            for host, session in sessions.items()
        }
        self.ending = Ending(stop, options.patience_s, listener)
        self.results: dict[int, StepResult] = {}
        self.lost, self.kinds = dict(lost), dict[str, set[str]]()

    def walk(self, batches: tuple[Batch, ...]) -> None:
        """Start each batch as soon as all that it needs has ended."""
        for batch in batches:
            self.kinds.setdefault(batch.host, set()).update(step.module for step in batch.steps)
        order = Order(batches)
        ready = order.first
        running: dict[int, Future[None]] = {}
        ended: queue.SimpleQueue[int] = queue.SimpleQueue()
        pool = concurrent.futures.ThreadPoolExecutor(max(1, min(self.options.forks, len(self.kinds))))
        try:
            while ready or running:
                for index in ready:
                    running[index] = pool.submit(self._run_batch, batches[index])
                    running[index].add_done_callback(lambda _done, index=index: ended.put(index))  # type: ignore[misc]
                ready = []
                for index in self._next(ended, running):
                    running.pop(index).result()
                    ready += order.ended(index)
                if self.ending.due():
                    self._give_up({batches[index].host for index in running}, running.values())
                    break
        finally:
            # whoever leaves at once does not wait for a build: it ends with its connection
            pool.shutdown(wait=False, cancel_futures=True)
        for batch in batches:
            why = self.ending.closed.get(batch.host, "interrupted")
            self._end_all(batch.steps, Outcome.NOT_REACHED, why)

    def _next(self, ended: queue.SimpleQueue[int], running: Mapping[int, Future[None]]) -> list[int]:
        """Wait a moment for the next end. An interrupt here asks for a soft stop; a second one leaves at once."""
        try:
            return [index for index in [ended.get(timeout=LOOK_S)] if index in running]
        except queue.Empty:  # an interrupt may have come between an end and its being noted here
            return [index for index, one in running.items() if one.done()]
        except KeyboardInterrupt:
            if self.stop.is_set():
                raise
            self.stop.set()
            self.listener(Event(kind="waiting", host="", text="interrupted: running steps end, no new one begins"))
            return []

    def _give_up(self, late: Collection[str], running: Collection[Future[None]]) -> None:
        """Cut robots off whose steps did not end in time after an interrupt; what even then goes on is left alone."""
        self.ending.close(late, self.sessions)
        concurrent.futures.wait(running, timeout=CLOSING_S)
        for host in late:
            self.robots.pop(host, None)

    def _run_batch(self, batch: Batch) -> None:
        robot = self.robots.get(batch.host)
        if robot is None:
            reason = self.lost.get(batch.host, "no connection")
            self._end_all(batch.steps, Outcome.UNREACHABLE, reason)
            return
        try:
            self._steps(robot, batch)
        except TransportError as error:
            self._mark_unreachable(batch.host, error)
            if batch.host in self.lost:
                self._end_all(batch.steps, Outcome.UNREACHABLE, error.told)

    def _steps(self, robot: RobotExecutor, batch: Batch) -> None:
        acted: list[Step] = []
        ahead = list(batch.steps)
        while ahead:
            step = ahead.pop(0)
            if self.stop.is_set() and step.number not in robot.stopped:
                self._end(StepResult(step=step, outcome=Outcome.NOT_REACHED, message="interrupted"))
            elif self._too_many():
                why = f"steps failed on more than {self.options.max_fail} robots"
                self._end(StepResult(step=step, outcome=Outcome.NOT_REACHED, message=why))
            elif blocked := self._blocked(step, acted):
                # an interrupt while it waited is not the fault of what it waited for
                outcome = Outcome.NOT_REACHED if self.stop.is_set() else Outcome.SKIPPED
                self._end(StepResult(step=step, outcome=outcome, message=blocked))
            else:
                if robot.seen is None:
                    robot.refresh(self.kinds[batch.host])
                robot.stop_together([step, *self._stopping_next(step, ahead, acted)])
                # a budget of failing robots is looked at before each step
                beside = ahead[: round_trip_size([step, *ahead]) - 1] if self.options.max_fail is None else []
                group = [step, *itertools.takewhile(lambda one: not self._blocked(one, acted), beside)]
                ahead, group = ahead[len(group) - 1 :], self._told(group, robot)
                for one, result in zip(group, robot.act(group), strict=True):
                    if result is None:
                        acted.append(one)
                    else:
                        self._end(result)
        if acted:
            robot.refresh({step.module for step in acted})
        for step in acted:
            self._end(robot.verdict(step))

    def _told(self, group: Sequence[Step], robot: RobotExecutor) -> list[Step]:
        """Return steps with what all robots of this run said by now, those that ask for it."""
        if not any(map(asks_others, group)):  # to look at all robots for each of them would take the square of time
            return list(group)
        there = {host: tuple((one.seen or {}).values()) for host, one in list(self.robots.items())}
        return [told(step, robot.seen or {}, there) for step in group]

    def _stopping_next(self, step: Step, ahead: Sequence[Step], acted: list[Step]) -> list[Step]:
        """Return the steps right behind one that stops a container which stop one too, and wait for nothing."""
        if not begins_with_stop(step) or self.options.max_fail is not None:  # a budget is looked at before each step
            return []
        stops = itertools.takewhile(begins_with_stop, ahead)
        return [one for one in stops if not one.waits and not self._blocked(one, acted)]

    def _too_many(self) -> bool:
        """Return whether the user's budget of failing robots is used up."""
        if self.options.max_fail is None:
            return False
        bad = (Outcome.FAILED, Outcome.UNREACHABLE)
        return len({r.step.host for r in list(self.results.values()) if r.outcome in bad}) > self.options.max_fail

    def _blocked(self, step: Step, acted: list[Step]) -> str:
        """Say why the step cannot be done, or nothing. Steps of this batch count as done until they are verified."""
        done = {one.number for one in acted}
        for number in step.needs:
            if number in done:
                continue
            result = self.results.get(number)
            if result is None or result.outcome not in (Outcome.CHANGED, Outcome.UNCHANGED):
                what = f"#{number}" if result is None else f"#{number} ({result.step.id}), which {past(result.outcome)}"
                return f"needs {what}"
        for need in step.waits:
            host = need.id.split("/", 1)[0]
            session = self.sessions.get(host)
            if session is None or host in self.lost:
                return f"needs {need.id} {need.condition}, but {host} is unreachable"

            def say(text: str) -> None:
                self.listener(Event(kind="waiting", host=step.host, step=step, text=text))

            try:
                why = wait_for(need, session, deadline_s=self.options.wait_timeout_s, stop=self.stop, say=say)
            except TransportError as error:
                self._mark_unreachable(host, error)
                return f"needs {need.id} {need.condition}: {error.message}"
            if why:
                return f"needs {need.id} {need.condition}: {why}"
        return ""

    def _mark_unreachable(self, host: str, error: TransportError) -> None:
        """Note that a robot cannot be talked to any more, unless it is we who ended that."""
        if host not in self.ending.closed:
            self.lost[host] = error.told
        self.robots.pop(host, None)

    def _end(self, result: StepResult) -> None:
        if result.step.host not in self.ending.closed:  # what such a robot's thread says so late is of no use
            self._note(result)

    def _note(self, result: StepResult) -> None:
        self.results[result.step.number] = result
        self.listener(ended_with(result))

    def _end_all(self, steps: tuple[Step, ...], outcome: Outcome, reason: str) -> None:
        for step in steps:
            if step.number not in self.results:
                self._note(StepResult(step=step, outcome=outcome, message=reason))
