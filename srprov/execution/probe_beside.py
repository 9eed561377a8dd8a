"""Whether the overlay works after a run: tried while services settle, when something of it changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from srprov.execution.outcome import Event, Listener, Outcome, StepResult
from srprov.modules import MODULES
from srprov.session import Session

if TYPE_CHECKING:
    from srprov.execution.probing import OverlayProbe
    from srprov.probing.verdict import Probed


@contextmanager
def probing_beside(
    probing: OverlayProbe | None, results: Iterable[StepResult], sessions: Mapping[str, Session], stop: threading.Event,
    listener: Listener,
) -> Iterator[Callable[[], Probed | None]]:  # fmt: skip
    """Try the overlay while the block runs; what it gives returns what came of that, after the block.

    Nothing is tried when nothing on the overlay changed, or after an interrupt.
    """
    if probing is None or stop.is_set() or not _changed(probing, results):
        yield lambda: None
        return
    from srprov.execution.probing import probe

    members = probing.request.robots
    listener(Event(kind="waiting", host="", text=f"trying the overlay between {len(members)} robots"))
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(probe, probing, sessions)
        yield future.result


def _changed(probing: OverlayProbe, results: Iterable[StepResult]) -> bool:
    """Return whether a run changed a link, or a container that is on the overlay."""
    services = {one.service for one in probing.request.endpoints}
    for one in results:
        step = one.step
        on_overlay = step.module != "container" or step.want is None or step.service in services
        if one.outcome is Outcome.CHANGED and MODULES[step.module].on_overlay and on_overlay:
            return True
    return False
