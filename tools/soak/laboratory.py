"""The lab, for as long as nobody else uses it."""

from __future__ import annotations

import fcntl
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from tests.lab.conftest import GUARD, Lab


@contextmanager
def guarded(wait_s: float) -> Iterator[Path]:
    """Keep all others off the lab, after at most so long a wait; give an empty folder."""
    with tempfile.TemporaryDirectory(prefix="srprov-soak-") as text, open(GUARD, "w", encoding="utf-8") as guard:
        print("waiting for the lab", flush=True)
        # a blocking wait has its turn after those who came before; a repeated look would come last
        before = signal.signal(signal.SIGALRM, _give_up)
        signal.setitimer(signal.ITIMER_REAL, wait_s)
        try:
            fcntl.flock(guard, fcntl.LOCK_EX)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
        os.environ["SRPROV_RUNS"] = str(Path(text) / "runs")  # not among the user's own
        yield Path(text)


def _give_up(_number: int, _frame: FrameType | None) -> None:
    sys.exit("others have kept the lab for too long (--lab-wait)")


@contextmanager
def laboratory(robots: int, wait_s: float) -> Iterator[tuple[Lab, Path]]:
    """Return a fresh lab of so many robots and a folder."""
    with guarded(wait_s) as folder:
        lab = Lab(folder)
        down(lab)  # one that is up may hold what somebody tried
        up = lab.srprov("lab", "up", "-n", str(robots))
        if up.code != 0:
            sys.exit(str(up))
        try:
            yield lab, folder / "experiment"
        finally:
            down(lab)


def down(lab: Lab) -> None:
    done = lab.srprov("lab", "down")
    if done.code != 0:
        sys.exit(str(done))
