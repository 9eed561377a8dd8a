"""Two controllers that race for the same robots, again and again: exactly one may act, and neither may hang."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

from tools.soak.results import Result
from tools.soak.tests import Outcome, run

TEST = "tests/lab/test_locks.py::test_race_exactly_one_acts"
BATCH = 10
ABOUT = """\
Two controllers want overlapping robots at once, on three robots. `passed`: one did all and ended well, the other
changed nothing and said who holds the robot (exit code 7), and no lock is held afterwards."""
RACE_LIMIT_S = 90.0
"""Of the batch's limit, for each of its races; a race that is stuck is ended by the test's own limits before."""


def soak(races: int, wait_s: float, tell: Callable[[Result], None]) -> bool:
    """Make so many races, with the lab given back in between; whether each had one winner."""
    outcomes: list[Outcome] = []
    seconds = 0.0
    for first in range(0, races, BATCH):
        turns = range(first, min(first + BATCH, races))
        limit = 300.0 + RACE_LIMIT_S * len(turns)
        env = {"SRPROV_RACES": str(races), "SRPROV_LAB_ROBOTS": "3"}
        found, took = run([f"{TEST}[{turn}]" for turn in turns], limit, wait_s, **env)
        outcomes, seconds = outcomes + found, seconds + took
        result = told(outcomes, seconds, races - len(outcomes))
        tell(result)
        time.sleep(1)  # whoever waits for the lab has it now
    return result.fine


def told(outcomes: list[Outcome], seconds: float, left: int) -> Result:
    """Return the figures and each race."""
    fine = [one for one in outcomes if one.fine]
    winners = Counter(str(one.said.get("winner")) for one in fine)
    won = ", ".join(f"{name} {count}" for name, count in sorted(winners.items()))
    stuck = sum(one.end == "not run" or "imeout" in one.why for one in outcomes)
    slowest = max((one.seconds for one in fine), default=0.0)
    return Result(
        "races",
        ABOUT,
        [
            f"{len(fine)} of {len(outcomes)} races: exactly one winner ({won})",
            f"{stuck} stuck; the slowest race took {slowest:.1f} s",
        ],
        ["| winner | race | took | end |", "|---|---|---|---|"]
        + [one.row(str(one.said.get("winner", "-"))) for one in outcomes],
        seconds,
        left,
        len(outcomes) - len(fine),
    )
