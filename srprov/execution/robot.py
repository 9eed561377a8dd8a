"""One robot's batch of steps: read, act, verify.

| moment | the module's `check` says | outcome                                       |
|--------|---------------------------|-----------------------------------------------|
| before | it is right               | unchanged: somebody was faster                |
| before | another change is due, or | failed: stale, plan again (`stale`)           |
|        | somebody else's is there  |                                               |
| act    | -                         | failed, with the command and what it said     |
| after  | still a change            | failed: did not converge                      |
| after  | it is right               | changed                                       |

What only shows when it is asked for is read right before and right after its own step.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution.failure_text import failure_text, last_lines
from srprov.execution.options import STOP_TIMEOUT_S
from srprov.execution.outcome import Event, Listener, Outcome, StepResult
from srprov.execution.sending import sent
from srprov.execution.stale import due, made_on_the_way, refused
from srprov.execution.stopping import stop_together
from srprov.execution.triggers import kept_apart, refuse_triggers
from srprov.execution.unfit_image import unfit
from srprov.failure import why
from srprov.modules import MODULES, PROBING, RUNNING
from srprov.modules.mount_place import guarded
from srprov.modules.observe import observe_queries, parse_observed, parse_probed, probe_queries
from srprov.planning.plan import Step
from srprov.resource import Action, Change, Observed
from srprov.robot_answers import answers_of
from srprov.session import Progress, Session
from srprov.wire import Command, CopyImage, EngineCall, Put, Reply, Run

_Key = tuple[str, str]
_MOST_BYTES = 256 * 1024
_LOG_LINES = 8


@dataclass(slots=True)
class RobotExecutor:
    """One robot during a run: its session and what was last seen there."""

    session: Session
    listener: Listener
    stop_timeout_s: float = STOP_TIMEOUT_S
    triggers: bool = False
    """ONBUILD instructions of bases may run."""
    leads: Mapping[str, str] = field(default_factory=dict)
    """Path that a new container mounts -> where it led when that was planned."""
    seen: dict[_Key, Observed] | None = None
    acted: dict[int, float] = field(default_factory=dict)
    """Step number -> seconds that the act took."""
    copied: dict[int, str] = field(default_factory=dict)
    """Step number -> what was sent of its image, in words."""
    made: set[str] = field(default_factory=set)
    """Ids that a step of this run made or changed, or made on its way."""
    stopped: set[int] = field(default_factory=set)
    """Numbers of steps whose container was stopped with others': these steps are under way."""

    def refresh(self, kinds: Collection[str]) -> None:
        """Read again everything of these kinds.

        Raises:
            TransportError: The robot or its engine does not answer. What cannot be read must not pass for gone: its
                service would be started elsewhere, and run twice.
        """
        wanted = sorted(kinds)
        replies = self.session.ask(observe_queries(wanted))
        for reply in replies:
            if not reply.ok:
                message = f"its state cannot be read: {why(reply)}"
                raise TransportError(self.session.host, message, hint="is its Docker Engine up?", code=Code.ENGINE)
        with answers_of(self.session.host):
            fresh = {(e.module, e.name): e for e in parse_observed(replies, wanted)}
        kept = {key: e for key, e in (self.seen or {}).items() if key[0] not in kinds or key[0] in PROBING}
        self.seen = kept | fresh

    def act(self, steps: Sequence[Step]) -> list[StepResult | None]:
        """Do steps unless they are done or stale; None means that one was done and must be verified.

        Several are done in one round trip; `round_trip_size` says which those may be.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        if len(steps) == 1:
            return [self._act(steps[0])]
        started = time.monotonic()
        for step in steps:
            self.listener(Event(kind="start", host=step.host, step=step))
        results: dict[int, StepResult | None] = {step.number: self._refused(step) for step in steps}
        left = [step for step in steps if results[step.number] is None]
        replies = self.session.execute_all([_only(step) for step in left])
        took = (time.monotonic() - started) / len(steps)
        for step, reply in zip(left, replies, strict=True):
            if reply.ok:
                self._done(step, took)
            else:
                why = failure_text(_only(step), reply)
                results[step.number] = StepResult(step=step, outcome=Outcome.FAILED, message=why, duration_s=took)
        return [results[step.number] for step in steps]

    def stop_together(self, steps: Sequence[Step]) -> None:
        """Stop the containers of several steps at once, of those that are still due.

        Raises:
            TransportError: The robot cannot be talked to any more.
        """
        left = [step for step in steps if step.number not in self.stopped and self._refused(step) is None]
        if len(left) > 1:
            told = f"stopping {len(left)} containers"
            self.listener(Event(kind="progress", host=left[0].host, step=left[0], text=told))
            self.stopped |= {step.number for step in left}
            self.session.execute(stop_together(left, self.stop_timeout_s))

    def _refused(self, step: Step) -> StepResult | None:
        """Say why a step is not to be done, or nothing."""
        return refused(step, (self.seen or {}).get((step.module, step.name)), self._due(step))

    def _act(self, step: Step) -> StepResult | None:
        """Do one step."""
        started = time.monotonic()
        self.listener(Event(kind="start", host=step.host, step=step))
        self._probe(step)
        if stale := self._refused(step):
            return stale
        self.made |= made_on_the_way(step)
        for command in step.commands:
            reply = self._execute(step, command, lambda line: self._progress(step, line))
            if not reply.ok:
                took, why = time.monotonic() - started, failure_text(command, reply)
                return StepResult(step=step, outcome=Outcome.FAILED, message=why, duration_s=took)
            if isinstance(command, CopyImage):
                self.copied[step.number] = reply.out
        self._probe(step)
        if step.module in PROBING and (more := self._due(step)):
            # what needs it must not begin, so it is not left to the end of the batch
            took, message = time.monotonic() - started, f"it ran, and did not converge: {more.cause}"
            return StepResult(step=step, outcome=Outcome.FAILED, message=message, duration_s=took)
        self._done(step, time.monotonic() - started)
        return None

    def _execute(self, step: Step, command: Command, progress: Progress) -> Reply:
        """Send one command of a step; a build only where it runs nothing that nobody was asked about."""
        if isinstance(command, EngineCall):
            command = kept_apart(command.stopping_within(self.stop_timeout_s))
            if (
                command.path == "/build"
                and not self.triggers
                and (no := refuse_triggers(command, self.session, progress))
            ):
                return no
        if step.module in RUNNING and step.want is not None:
            command = guarded(command, step.want.params.mounts, self.leads)
        reply = sent(command, self.session, progress)
        return (unfit(step, self.session) if reply.ok else None) or reply

    def _done(self, step: Step, took_s: float) -> None:
        """Remember that a step was done, and is to be verified."""
        if step.change.action is Action.DELETE and self.seen is not None:
            # a later step of this batch makes the same thing anew: for it, it is gone
            self.seen.pop((step.module, step.name), None)
            self.made.discard(step.id)
        if step.want is not None:
            self.made.add(step.id)
        self.acted[step.number] = took_s

    def verdict(self, step: Step, failed: str = "did not converge") -> StepResult:
        """Return what came of a step that was acted on, by what `refresh` saw after it; `failed` begins its message."""
        more = self._due(step)
        remade = step.want is None and step.id in self.made
        if more is None or remade:
            seen = (self.seen or {}).get((step.module, step.name))
            took, sent, after = self.acted[step.number], self.copied.get(step.number, ""), seen.state if seen else None
            return StepResult(step=step, outcome=Outcome.CHANGED, message=sent, duration_s=took, after=after)
        message = f"{failed}: {more.cause}{self._log_end(step)}"
        return StepResult(step=step, outcome=Outcome.FAILED, message=message, duration_s=self.acted[step.number])

    def _probe(self, step: Step) -> None:
        """Look at what only shows when it is asked for: what ran before in this run may have changed it."""
        if step.want is not None and step.module in PROBING:
            replies = self.session.ask(probe_queries([step.want]))
            with answers_of(self.session.host):
                seen = {(one.module, one.name): one for one in parse_probed(replies, [step.want])}
            self.seen = (self.seen or {}) | seen

    def _due(self, step: Step) -> Change | None:
        item = (self.seen or {}).get((step.module, step.name))
        return self._ordered(step, item) if step.order and step.want is None else due(step, item)

    def _ordered(self, step: Step, item: Observed | None) -> Change | None:
        """Return what is left of a user's order: all of it before the act, unless it has come true by itself."""
        if item is None:
            return None if step.order == "stop" else Change(action=Action.UPDATE, cause="it is not there any more")
        acted = step.number in self.acted
        job = acted and step.found is not None and step.found.state.get("job") is True
        why = RUNNING[step.module].ordered({**item.state, "job": job}, step.order)
        if step.order == "restart" and not acted:
            why = "not started again yet"
        return Change(action=Action.UPDATE, cause=why) if why else None

    def _log_end(self, step: Step) -> str:
        """Return the end of the log of a step's service, indented under a failure, or nothing when there is none."""
        if step.module not in RUNNING:
            return ""
        reply = self.session.ask([RUNNING[step.module].log_query(step.name, _LOG_LINES)])[0]
        if not reply.ok or not reply.out.strip():
            return ""
        return "\n  its last lines:\n" + "\n".join(f"    {one}" for one in last_lines(reply.out, _LOG_LINES))

    def _progress(self, step: Step, line: str) -> None:
        self.listener(Event(kind="progress", host=step.host, step=step, text=line))


def round_trip_size(steps: Sequence[Step]) -> int:
    """Return how many of the first steps may be done in one round trip, at least one.

    There are more only while each is one short script or file for the shell and none needs another of them, so that
    nothing is done that would not be done if one of them failed.
    """
    begun: set[int] = set()
    size = 0
    for step in steps:
        if (
            not MODULES[step.module].shares_round_trip
            or len(step.commands) != 1
            or step.waits
            or not begun.isdisjoint(step.needs)
        ):
            break
        command = _only(step)
        size += len(command.content if isinstance(command, Put) else command.script)
        if size > _MOST_BYTES:
            break
        begun.add(step.number)
    return max(1, len(begun))


def _only(step: Step) -> Run | Put:
    (command,) = step.commands
    assert isinstance(command, Run | Put)
    return command
