"""Live progress of a run: lines that name robot, step and what is awaited; on a terminal also a status line.

Lines go to stderr: one for each finished step, so that a log file reads as well as a terminal. `--events` gets every
event as JSON.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from srprov.cli.output import err, is_terminal, line_of, wants_color

if TYPE_CHECKING:
    from srprov.execution import Event, Listener
    from srprov.planning.plan import Plan

_SYMBOL_COLORS = {"changed": "green", "removed": "green", "unchanged": "blue", "failed": "red", "skipped": "yellow"}
_PROGRESS_EVERY_S = 5.0


@contextmanager
def progress(
    plan: Plan, *, events: TextIO | None, color: bool, quiet: bool = False, lines_only: bool = False
) -> Iterator[Listener]:
    """Return a listener for one run; the status line goes away at the end. With `lines_only` there is none."""
    live = bool(plan.steps) and not quiet and not lines_only and is_terminal(sys.stderr)
    shown = _Shown(len(plan.steps), events, live=live, color=color and wants_color(sys.stderr), quiet=quiet)
    if not live:
        yield shown.listen
        return
    from srprov.cli.status_line import status_line

    with status_line(lambda: shown.status, color=shown.color):
        yield shown.listen


class _Shown:
    """What was shown so far; called from several threads."""

    def __init__(self, total: int, stream: TextIO | None, *, live: bool, color: bool, quiet: bool) -> None:
        self.total, self.stream = total, stream
        self.live, self.color, self.quiet = live, color, quiet
        self.done = 0
        self.status = "starting"
        self.running: dict[str, str] = {}
        self.last_said: dict[str, float] = {}
        self.lock = threading.Lock()

    def listen(self, event: Event) -> None:
        """Show one event."""
        from srprov.record import event_json

        with self.lock:
            if self.stream:
                self._write(self.stream, line_of(event_json(event)))
            getattr(self, f"_{event.kind}")(event)
            self.status = f"{self.done}/{self.total} " + "; ".join(text for _, text in sorted(self.running.items()))

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
        now = time.monotonic()
        if words and not self.live and now - self.last_said.get(event.host, 0.0) > _PROGRESS_EVERY_S:
            self.last_said[event.host] = now
            self._say(f"  … {text}")

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
        word = event.outcome.value
        if word == "not reached":
            return  # the report at the end lists each with its reason
        if word == "changed" and event.step.change.action.name == "DELETE":
            word = "removed"
        took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1 else ""
        why = f": {event.text.splitlines()[0]}" if event.text and word != "unchanged" else ""
        what = f"{event.host}: {event.step.change.action.value} {event.step.module} {event.step.name}"
        color = _SYMBOL_COLORS.get(word) if self.color else None
        self._say(f"[{min(self.done, self.total)}/{self.total}] {what}: {word}{took}{why}", color)

    def _say(self, text: str, color: str | None = None) -> None:
        if not self.quiet:
            err(text, color)
