"""Robots that must be right before a trial begins: measured, waited for while one is not, and refused in the end.

Takes limits and robots; gives their clocks. Nothing of the trial is made yet.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from srprov.definitions.trialsmodel import Limits
from srprov.execution.trial_patience import EquipmentFailed
from srprov.execution.trial_robots import TrialRobots
from srprov.trials.clock import Offset
from srprov.trials.limits import Finding, check

_AGAIN_S = 2.0
_REMIND_S = 30.0


def admit(limits: Limits, robots: TrialRobots, told: set[tuple[str, str]]) -> Mapping[str, Offset | None]:
    """Return the robots' clocks once all of them are within the limits.

    Args:
        limits: What they must be like.
        robots: Those of the trial.
        told: Robots and limits of which was said that nothing can be told; said once.

    Raises:
        EquipmentFailed: One of them is not so in time.
    """
    begun, said = time.monotonic(), -_REMIND_S
    while True:
        clocks = robots.clocks()
        found = _findings(limits, robots, clocks)
        for one in found:
            if not one.surely and (one.robot, one.limit) not in told:
                told.add((one.robot, one.limit))
                robots.say(f"cannot tell: {one.text}")
        beyond = [one.text for one in found if one.surely]
        waited = time.monotonic() - begun
        if not beyond:
            return clocks
        if waited >= limits.wait_s:
            raise EquipmentFailed("; ".join(beyond))
        if waited - said >= _REMIND_S:
            said = waited
            robots.say(f"waiting up to {limits.wait_s - waited:.0f} s: {'; '.join(beyond)}")
        time.sleep(max(0.0, min(_AGAIN_S, limits.wait_s - waited)))
        robots.forget()


def _findings(limits: Limits, robots: TrialRobots, clocks: Mapping[str, Offset | None]) -> list[Finding]:
    if not limits.any:
        return []
    hosts = robots.totals.hosts
    return [one for robot in sorted(hosts) for one in check(limits, robot, clocks.get(robot), hosts[robot][-1])]
