"""Disturb an apply at every moment that its events name, and write what came of each to a Markdown table.

`make soak` does all of it; `python -m tools.soak --every 5` every fifth moment. It needs what the lab needs, takes the
lab for itself for a few minutes at a time, and brings it down in the end. Exit code 0: after each disturbance the next
apply ended as if nothing had been.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.lab.conftest import Lab
from tests.lab.survival import ROBOTS, Survivor, kill, prepare

RESULTS = Path(__file__).parent / "results.md"
VICTIM = "robot2"
STRETCH_S = 200.0
"""The lab is given back after so long: whoever waits for it waits not much longer, and later turns see a fresh one."""

Disturb = Callable[[Survivor], int]
"""Applies, disturbs that, and gives its exit code."""


@dataclass(frozen=True)
class Turn:
    """One disturbance and what came of it."""

    fault: str
    moment: str
    code: int
    left: int
    """Steps that the next apply had to do."""
    seconds: float
    """Of the next apply."""
    wrong: str = ""

    def row(self) -> str:
        end = self.wrong or "equal"
        return f"| {self.fault} | {self.moment} | {self.code} | {self.left} | {self.seconds:.1f} s | {end} |"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only every Nth moment (default: all)")
    parser.add_argument("--output", type=Path, default=RESULTS, help="the table")
    wanted = parser.parse_args()
    seconds, turns = 0.0, []
    left: deque[tuple[str, str, Disturb]] | None = None
    while left is None or left:
        with laboratory() as (lab, folder):
            begun = time.monotonic()
            survivor = prepare(lab, folder)
            left = deque(moments(survivor, wanted.every)) if left is None else left
            while left and time.monotonic() - begun < STRETCH_S:
                turns.append(one(survivor, *left.popleft()))
                print(f"{turns[-1].row()} {len(left)} to go", flush=True)
                text = report(survivor, turns, len(left), wanted.every, seconds + time.monotonic() - begun)
                wanted.output.write_text(text, encoding="utf-8")
            seconds += time.monotonic() - begun
        time.sleep(1)  # whoever waits for the lab has it now
    return 1 if not turns or any(turn.wrong for turn in turns) else 0


@contextmanager
def laboratory() -> Iterator[tuple[Lab, Path]]:
    """Give a lab of four robots, which nobody else uses meanwhile, and a folder."""
    with tempfile.TemporaryDirectory(prefix="srprov-soak-") as text, open("/run/lock/srprov-lab-tests", "w") as guard:
        print("waiting for the lab", flush=True)
        fcntl.flock(guard, fcntl.LOCK_EX)
        os.environ["SRPROV_RUNS"] = str(Path(text) / "runs")  # not among the user's own
        lab = Lab(Path(text))
        up = lab.srprov("lab", "up", "-n", str(len(ROBOTS)))
        if up.code != 0:
            sys.exit(str(up))
        try:
            yield lab, Path(text) / "experiment"
        finally:
            down = lab.srprov("lab", "down")
            if down.code != 0:
                sys.exit(str(down))


def moments(survivor: Survivor, every: int) -> Iterator[tuple[str, str, Disturb]]:
    """Give fault, moment, and what makes the one happen at the other."""
    for kind in ("end", "start"):
        for count in range(1, survivor.steps + 1, every):
            yield "controller killed", f"{kind} {count}", lambda s, k=kind, c=count: s.disturb(k, c, kill).code
    mine = sum(step.startswith(f"{VICTIM}/") for step in survivor.ids)
    for count in range(1, mine + 1, every):
        moment = f"start {count} of {VICTIM}"
        yield "engine killed", moment, lambda s, c=count: s.disturb("start", c, crash(s.lab), f"{VICTIM}/").code
        yield "network cut", moment, lambda s, c=count: cut_and_heal(s, c)


def crash(lab: Lab) -> Callable[[subprocess.Popen[str]], None]:
    """Give what kills the victim's engine."""
    return lambda _run: succeed(lab, "kill", VICTIM, "--docker")


def cut_and_heal(survivor: Survivor, count: int) -> int:
    """Cut the victim off until the apply has ended."""

    def cut(_run: subprocess.Popen[str]) -> None:
        succeed(survivor.lab, "partition", VICTIM)

    try:
        return survivor.disturb("start", count, cut, f"{VICTIM}/").code
    finally:
        succeed(survivor.lab, "heal", VICTIM)


def succeed(lab: Lab, *words: str) -> None:
    done = lab.srprov("lab", *words)
    assert done.code == 0, done


def one(survivor: Survivor, fault: str, moment: str, disturb: Disturb) -> Turn:
    """Disturb once, apply again, compare; whatever is wrong becomes words, and the robots are empty afterwards."""
    code, left, seconds, wrong = 0, 0, 0.0, ""
    try:
        code = disturb(survivor)
        begun = time.monotonic()
        again = survivor.assert_converges()
        left, seconds = again.json["changed"], again.json["duration_s"] or time.monotonic() - begun
    except (AssertionError, subprocess.TimeoutExpired) as error:
        wrong = " ".join(str(error).split())[:300].replace("|", "/")
    survivor.clear()
    return Turn(fault, moment, code, left, seconds, wrong)


def report(survivor: Survivor, turns: list[Turn], left: int, every: int, seconds: float) -> str:
    """Give the document: figures first, then each turn."""
    which = "every moment" if every == 1 else f"one moment in {every}"
    faults = list(dict.fromkeys(turn.fault for turn in turns))
    lines = [
        "# Soak",
        "",
        "Written by `make soak`. Six services on four robots are applied and disturbed at one moment; then they are",
        "applied again. `equal`: containers with their config hashes and addresses, networks, volumes, links with",
        "their forwarding entries and files with their modes are on all robots as after an undisturbed apply, each",
        "once; no lock is held, no process of the first run goes on, and a third apply has nothing to do.",
        "",
        f"- {survivor.steps} steps, {which}, {seconds / 60:.0f} min",
        *([f"- ended early: {left} moments were not tried"] if left else []),
    ]
    for fault in faults:
        mine = [turn for turn in turns if turn.fault == fault]
        fine = [turn for turn in mine if not turn.wrong]
        slowest = max((turn.seconds for turn in fine), default=0.0)
        lines.append(f"- {fault}: {len(fine)} of {len(mine)} equal; the slowest next apply took {slowest:.1f} s")
    head = ["", "| fault | at event | exit code | steps left | next apply | end |", "|---|---|---|---|---|---|"]
    return "\n".join([*lines, *head, *(turn.row() for turn in turns)]) + "\n"


if __name__ == "__main__":
    sys.exit(main())
