"""Whether the overlay works after a run: tried while services settle, when something of it changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from srprov.execution.outcome import Event, Listener, Outcome, StepResult
from srprov.modules import MODULES
from srprov.planning.plan import Step
from srprov.session import Session

if TYPE_CHECKING:
    from srprov.execution.probing import Brought, OverlayProbe
    from srprov.probing.verdict import Probed


@contextmanager
def bringing_ahead(
    probing: OverlayProbe | None, steps: Collection[Step], sessions: Mapping[str, Session]
) -> Iterator[Future[Brought] | None]:
    """Bring the probe's program to the robots that are changed while the block works on them; say where it is.

    While a robot's engine works, its shell has nothing to do; at the end of a run all robots would wait for this.
    Nothing is brought when no step is about the overlay.
    """
    if probing is None or not _about_overlay(probing, steps):
        yield None
        return
    from srprov.execution.probing import bring

    robots = {step.host for step in steps}
    pool = ThreadPoolExecutor(1)
    try:
        yield pool.submit(bring, probing, {name: one for name, one in sessions.items() if name in robots})
    finally:
        pool.shutdown(wait=False)  # who leaves at once does not wait for a slow robot


@contextmanager
def probing_beside(
    probing: OverlayProbe | None, results: Iterable[StepResult], sessions: Mapping[str, Session],
    stop: threading.Event, listener: Listener, brought: Future[Brought] | None,
) -> Iterator[Callable[[], Probed | None]]:  # fmt: skip
    """Try the overlay while the block runs; what it gives returns what came of that, after the block.

    Nothing is tried when nothing on the overlay changed, or after an interrupt.
    """
    changed = [one.step for one in results if one.outcome is Outcome.CHANGED]
    if probing is None or stop.is_set() or not _about_overlay(probing, changed):
        yield lambda: None
        return
    from srprov.execution.probing import probe

    members = probing.request.robots
    listener(Event(kind="waiting", host="", text=f"trying the overlay between {len(members)} robots"))
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(probe, probing, sessions, brought.result() if brought else None)
        yield future.result


def _about_overlay(probing: OverlayProbe, steps: Collection[Step]) -> bool:
    """Return whether any of the steps is about a link, or a container that is on the overlay."""
    services = {one.service for one in probing.request.endpoints}
    return any(
        MODULES[one.module].on_overlay and (one.module != "container" or one.want is None or one.service in services)
        for one in steps
    )
