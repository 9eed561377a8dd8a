"""A last check: a service counts as started only if it still runs a little later.

An engine also says "started" of a process that ends at once. Each robot with services that were started is read once
more, two seconds (or what the user sets) after the last start; jobs may have ended.
"""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections.abc import Mapping

from msgspec.structs import replace

from srprov.errors import TransportError
from srprov.execution.options import MOST_AT_ONCE
from srprov.execution.outcome import Event, Listener, Outcome, StepResult
from srprov.execution.robot import RobotExecutor
from srprov.modules import RUNNING
from srprov.resource import Action


def settle(
    robots: Mapping[str, RobotExecutor],
    results: Mapping[int, StepResult],
    settle_s: float,
    stop: threading.Event,
    listener: Listener,
) -> dict[int, StepResult]:
    """Return the results with those services turned to failed that did not stay up."""
    fresh: dict[str, list[StepResult]] = {}
    for result in results.values():
        step = result.step
        started = result.outcome is Outcome.CHANGED and step.change.action is not Action.DELETE
        if started and step.module in RUNNING and step.host in robots:
            fresh.setdefault(step.host, []).append(result)
    settled = dict(results)
    if not fresh or settle_s <= 0:
        return settled
    listener(Event(kind="waiting", host="", text=f"checking that services stay up for {settle_s:g} s"))
    stop.wait(settle_s)
    with concurrent.futures.ThreadPoolExecutor(min(len(fresh), MOST_AT_ONCE)) as pool:
        for checked in pool.map(lambda item: _check(robots[item[0]], item[1]), sorted(fresh.items())):
            for result in checked:
                settled[result.step.number] = result
                if result.outcome is Outcome.FAILED:
                    listener(
                        Event(
                            kind="end",
                            host=result.step.host,
                            step=result.step,
                            outcome=result.outcome,
                            text=result.message,
                        )
                    )
    return settled


def _check(robot: RobotExecutor, fresh: list[StepResult]) -> list[StepResult]:
    begun = time.monotonic()
    try:
        robot.refresh({result.step.module for result in fresh})
        return [robot.verdict(result.step, "did not stay up") for result in fresh]
    except TransportError as error:
        took = time.monotonic() - begun
        return [replace(r, outcome=Outcome.UNREACHABLE, message=error.told, duration_s=took) for r in fresh]
