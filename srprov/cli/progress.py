"""Live progress of a run: lines that name robot, step and what is awaited; on a terminal also a status line.

Lines go to stderr: one for each finished step, so that a log file reads as well as a terminal. Of many robots it is
summed up every few seconds, and only what does not end well has lines, the first of them. `--events` gets every event
as JSON.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from srprov.cli.output import err, is_terminal, line_of, wants_color

if TYPE_CHECKING:
    from srprov.execution import Event, Listener
    from srprov.planning.plan import Plan

_SYMBOL_COLORS = {"changed": "green", "removed": "green", "unchanged": "blue", "failed": "red", "skipped": "yellow"}
_PROGRESS_EVERY_S = 5.0
_ALL = "all robots"
_MANY = 50
"""Robots: what more of them do is summed up."""
_MOST_TOLD = 20
"""Steps of many robots that are told when they do not end well; the report at the end lists all."""


@contextmanager
def progress(
    plan: Plan, *, events: TextIO | None, color: bool, quiet: bool = False, lines_only: bool = False
) -> Iterator[Listener]:
    """Return a listener for one run; the status line goes away at the end. With `lines_only` there is none."""
    live = bool(plan.steps) and not quiet and not lines_only and is_terminal(sys.stderr)
    hosts = [step.host for step in plan.steps]
    shown = _Shown(hosts, events, live=live, color=color and wants_color(sys.stderr), quiet=quiet)
    if not live:
        yield shown.listen
        return
    from srprov.cli.status_line import status_line

    with status_line(lambda: shown.status, color=shown.color):
        yield shown.listen


class _Shown:
    """What was shown so far; called from several threads."""

    def __init__(self, hosts: Iterable[str], stream: TextIO | None, *, live: bool, color: bool, quiet: bool) -> None:
        """Take the robot of each step, and where events go."""
        self.left = Counter(hosts)
        self.total, self.robots, self.stream = self.left.total(), len(self.left), stream
        self.many, self.over = self.robots > _MANY, 0
        self.bad: Counter[str] = Counter()
        self.live, self.color, self.quiet = live, color, quiet
        self.done = 0
        self.status = "starting"
        self.running: dict[str, str] = {}
        self.last_said = {_ALL: time.monotonic()}
        self.lock = threading.Lock()

    def listen(self, event: Event) -> None:
        """Show one event."""
        from srprov.record import event_json

        with self.lock:
            if self.stream:
                self._write(self.stream, line_of(event_json(event)))
            getattr(self, f"_{event.kind}")(event)
            self.status = self._summed_up() if self.many else self._each()

    def _each(self) -> str:
        """Say what each robot is at."""
        return f"{self.done}/{self.total} " + "; ".join(text for _, text in sorted(self.running.items()))

    def _summed_up(self) -> str:
        """Say how far all robots are, and what one of those at work is at."""
        bad = "".join(f", {count} {word}" for word, count in sorted(self.bad.items()))
        first = min(self.running.items(), default=("", ""))[1]
        more = f" and {len(self.running) - 1} more" if len(self.running) > 1 else ""
        now = f"; {first}{more}" if first else ""
        return f"{self.done}/{self.total} steps, {self.over}/{self.robots} robots done{bad}{now}"

    def _write(self, stream: TextIO, line: str) -> None:
        """Write to `--events`. A file that cannot be written any more gets one warning, and stops nothing."""
        try:
            stream.write(line)
            stream.flush()
        except OSError as error:
            self.stream = None
            err(f"warning: no more events are written to {stream.name}: {error.strerror}")

    def _start(self, event: Event) -> None:
        if event.step:
            self.running[event.host] = f"{event.host}: {event.step.module} {event.step.name}"

    def _progress(self, event: Event) -> None:
        """A build prints a lot: without a status line, a line every few seconds is enough to see that it goes on."""
        words = " ".join(event.text.split())
        text = f"{event.host}: {words}" if event.host else words
        self.running[event.host] = text
        if self.many and event.host:
            self._sum_up()
        elif words and not self.live and self._is_time(event.host):
            self._say(f"  … {text}")

    def _sum_up(self) -> None:
        """Say how far all robots are, where no status line does."""
        if not self.live and self._is_time(_ALL):
            self._say(f"  … {self._summed_up()}")

    def _is_time(self, what: str) -> bool:
        """Return whether something may be said again, and note that it is."""
        now = time.monotonic()
        if now - self.last_said.get(what, 0.0) <= _PROGRESS_EVERY_S:
            return False
        self.last_said[what] = now
        return True

    def _waiting(self, event: Event) -> None:
        """What the whole run waits for is always said: it says why nothing else comes."""
        if not event.host:
            self.last_said.pop("", None)
        self._progress(event)

    def _end(self, event: Event) -> None:
        self.running.pop(event.host, None)
        if event.step is None or event.outcome is None:
            return
        self.done += 1
        self.left[event.host] -= 1
        self.over += self.left[event.host] == 0
        word = event.outcome.value
        if word == "not reached":
            return  # the report at the end lists each with its reason
        if word == "changed" and event.step.change.action.name == "DELETE":
            word = "removed"
        took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1 else ""
        why = f": {event.text.splitlines()[0]}" if event.text and word != "unchanged" else ""
        what = f"{event.host}: {event.step.change.action.value} {event.step.module} {event.step.name}"
        color = _SYMBOL_COLORS.get(word) if self.color else None
        if self.many and self._is_only_counted(word):
            self._sum_up()
            return
        self._say(f"[{min(self.done, self.total)}/{self.total}] {what}: {word}{took}{why}", color)

    def _is_only_counted(self, word: str) -> bool:
        """Return whether a step's end has no line of its own: it is well, or too many are not."""
        if word in ("changed", "removed", "unchanged"):
            return True
        self.bad[word] += 1
        if (count := self.bad.total()) == _MOST_TOLD + 1:
            self._say("  … further steps that do not end well are counted here, and listed at the end")
        return count > _MOST_TOLD

    def _say(self, text: str, color: str | None = None) -> None:
        if not self.quiet:
            err(text, color)
