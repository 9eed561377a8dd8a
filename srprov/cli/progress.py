"""Live progress of a run: lines that name robot, step and what is awaited; on a terminal a status line besides.

Lines go to stderr; a line per finished step, so that a log file reads as well as a terminal. `--events` gets every
event as JSON.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from srprov.cli.output import clean, err, line_of, wants_color

if TYPE_CHECKING:
    from srprov.execution import Event, Listener
    from srprov.planning.plan import Plan

_SYMBOL_COLORS = {"changed": "green", "unchanged": "blue", "failed": "red", "skipped": "yellow"}
_PROGRESS_EVERY_S = 5.0


@contextmanager
def progress(plan: Plan, *, events: str | None, color: bool) -> Iterator[Listener]:
    """Return a listener for one run; the status line goes away at the end."""
    with ExitStack() as stack:
        stream = stack.enter_context(open(events, "w", encoding="utf-8")) if events else None
        live = stack.enter_context(_live()) if sys.stderr.isatty() and plan.steps else None
        shown = _Shown(len(plan.steps), stream, live, color=color and wants_color(sys.stderr))
        yield shown.listen


@contextmanager
def _live() -> Iterator[Any]:
    """Return rich's status line; imported only on a terminal."""
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield status


def _plain(status: str) -> Any:  # noqa: ANN401 - rich's Text
    """Return rich's Text, in which `[x]` in a robot's words is no markup."""
    from rich.text import Text

    return Text(clean(status)[:200])


class _Shown:
    """What was shown so far; called from several threads."""

    def __init__(
        self,
        total: int,
        stream: TextIO | None,
        live: Any,  # noqa: ANN401 - rich's Status or None
        *,
        color: bool,
    ) -> None:
        self.total, self.stream, self.live, self.color = total, stream, live, color
        self.done = 0
        self.running: dict[str, str] = {}
        self.last_said: dict[str, float] = {}
        self.lock = threading.Lock()

    def listen(self, event: Event) -> None:
        """Show one event."""
        from srprov.record import event_json

        with self.lock:
            if self.stream:
                self.stream.write(line_of(event_json(event)))
                self.stream.flush()
            getattr(self, f"_{event.kind}")(event)
            if self.live:
                self.live.update(_plain(self._status()))

    def _start(self, event: Event) -> None:
        if event.step:
            self.running[event.host] = f"{event.host}: {event.step.module} {event.step.name}"

    def _progress(self, event: Event) -> None:
        """A build says much: off the terminal one line every few seconds is enough to see that it lives."""
        now = time.monotonic()
        text = f"{event.host}: {' '.join(event.text.split())}"
        self.running[event.host] = text
        if not self.live and event.text.strip() and now - self.last_said.get(event.host, 0.0) > _PROGRESS_EVERY_S:
            self.last_said[event.host] = now
            err(f"  … {text}")

    def _waiting(self, event: Event) -> None:
        text = f"{event.host}: {event.text}" if event.host else event.text
        self.running[event.host] = text
        now = time.monotonic()
        if not self.live and now - self.last_said.get(event.host, 0.0) > _PROGRESS_EVERY_S:
            self.last_said[event.host] = now
            err(f"  … {text}")

    def _end(self, event: Event) -> None:
        self.running.pop(event.host, None)
        if event.step is None or event.outcome is None:
            return
        self.done += 1
        word = event.outcome.value
        took = f" ({event.duration_s:.1f} s)" if event.duration_s >= 1 else ""
        failed = f": {event.text.splitlines()[0]}" if event.text and word not in ("changed", "unchanged") else ""
        symbol = event.step.change.action.value
        what = f"{event.host}: {symbol} {event.step.module} {event.step.name}"
        err(
            f"[{min(self.done, self.total)}/{self.total}] {what}: {word}{took}{failed}",
            color=_SYMBOL_COLORS.get(word) if self.color else None,
        )

    def _status(self) -> str:
        return f"{self.done}/{self.total} " + "; ".join(text for _, text in sorted(self.running.items()))
