"""An apply that is disturbed at every moment that its events name: the next one must end as if nothing had been."""

from __future__ import annotations

import subprocess
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tests.lab.conftest import Lab
from tests.lab.survival import ROBOTS, Survivor, kill, prepare, wait_for_engine
from tools.soak.laboratory import laboratory
from tools.soak.results import Result

VICTIM = "robot2"
STRETCH_S = 200.0
"""The lab is given back after so long: whoever waits for it waits not much longer, and later turns see a fresh one."""
STARTS = 14
BETWEEN_STARTS_S = 0.05
"""An engine on a loaded machine takes half a second from a container made to its process."""
BARREN_STRETCHES = 3
"""So many in which no turn could be made, and it is over."""

ABOUT = """\
Six services on four robots are applied and disturbed at one moment; then they are applied again. `equal`: containers
with their config hashes and addresses, networks, volumes, links with their forwarding entries and files with their
modes are on all robots as after an undisturbed apply, each once; no lock is held, no process of the first run goes on,
no shim of containerd is left without its container,
and a third apply has nothing to do."""

Disturb = Callable[[Survivor], int]
"""Applies, disturbs that, and gives its exit code."""
Moment = tuple[str, str, Disturb]
"""Fault, moment, and what makes the one happen at the other."""


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
    clean: bool = True
    """Whether the robots are empty again."""

    def row(self) -> str:
        end = self.wrong or "equal"
        return f"| {self.fault} | {self.moment} | {self.code} | {self.left} | {self.seconds:.1f} s | {end} |"


def soak(every: int, wait_s: float, tell: Callable[[Result], None]) -> bool:
    """Take every Nth moment, with the lab given back in between; whether all ended equal."""
    turns: list[Turn] = []
    left: deque[Moment] | None = None
    seconds, steps, barren = 0.0, 0, 0
    while (left is None or left) and barren < BARREN_STRETCHES:
        made = len(turns)
        with laboratory(len(ROBOTS), wait_s) as (lab, folder):
            begun = time.monotonic()
            try:
                survivor = prepare(lab, folder)
            except (AssertionError, subprocess.TimeoutExpired) as error:
                print(f"no undisturbed apply to compare with: {error}", flush=True)
                barren, seconds = barren + 1, seconds + time.monotonic() - begun
                continue
            steps = survivor.steps
            left = deque(moments(survivor, every)) if left is None else left
            while left and time.monotonic() - begun < STRETCH_S and (len(turns) == made or turns[-1].clean):
                turns.append(one(survivor, *left.popleft()))
                print(f"{turns[-1].row()} {len(left)} to go", flush=True)
                tell(told(turns, steps, every, len(left), seconds + time.monotonic() - begun))
            seconds, barren = seconds + time.monotonic() - begun, 0
        time.sleep(1)  # whoever waits for the lab has it now
    return bool(turns) and not left and not any(turn.wrong for turn in turns)


def moments(survivor: Survivor, every: int) -> Iterator[Moment]:
    """Return fault, moment, and what makes the one happen at the other."""
    for kind in ("end", "start"):
        for count in range(1, survivor.steps + 1, every):
            yield "controller killed", f"{kind} {count}", lambda s, k=kind, c=count: s.disturb(k, c, kill).code
    mine = sum(step.startswith(f"{VICTIM}/") for step in survivor.ids)
    for count in range(1, mine + 1, every):
        moment = f"start {count} of {VICTIM}"
        yield "engine killed", moment, lambda s, c=count: crash_and_return(s, c)
        yield "network cut", moment, lambda s, c=count: cut_and_heal(s, c)
    for turn in range(0, STARTS, every):
        after = turn * BETWEEN_STARTS_S
        moment = f"{after * 1000:.0f} ms after a container was made"
        yield "engine killed while it starts a container", moment, lambda s, a=after: crash_while_starting(s, a)


def crash_and_return(survivor: Survivor, count: int) -> int:
    """Kill the victim's engine; it is back when the next apply begins, which else would rightly call it unreachable."""

    def crash(_run: subprocess.Popen[str]) -> None:
        succeed(survivor.lab, "kill", VICTIM, "--docker")

    try:
        return survivor.disturb("start", count, crash, f"{VICTIM}/").code
    finally:
        wait_for_engine(survivor.lab, VICTIM)


def crash_while_starting(survivor: Survivor, after_s: float) -> int:
    """Kill the victim's engine so many seconds after it made a container; it is back when the next apply begins."""
    try:
        return survivor.kill_engine_while_it_starts(VICTIM, after_s).code
    finally:
        wait_for_engine(survivor.lab, VICTIM)


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
    """Disturb once, apply again, compare, and empty the robots; whatever is wrong becomes words."""
    code, left, seconds, wrong, clean = 0, 0, 0.0, "", True
    try:
        code = disturb(survivor)
        begun = time.monotonic()
        again = survivor.assert_converges()
        left, seconds = again.json["changed"], again.json["duration_s"] or time.monotonic() - begun
    except (AssertionError, subprocess.TimeoutExpired) as error:
        wrong = in_a_cell(error)
    try:
        survivor.clear()
    except (AssertionError, subprocess.TimeoutExpired) as error:
        wrong, clean = wrong or f"destroy: {in_a_cell(error)}", False
    return Turn(fault, moment, code, left, seconds, wrong, clean)


def in_a_cell(error: Exception) -> str:
    print(error, flush=True)
    return " ".join(str(error).split())[:300].replace("|", "/") or type(error).__name__


def told(turns: list[Turn], steps: int, every: int, left: int, seconds: float) -> Result:
    """Return the figures and each turn."""
    which = "every moment" if every == 1 else f"one moment in {every}"
    figures = [f"{steps} steps, {which}: {len(turns)} turns"]
    for fault in dict.fromkeys(turn.fault for turn in turns):
        mine = [turn for turn in turns if turn.fault == fault]
        fine = [turn for turn in mine if not turn.wrong]
        slowest = max((turn.seconds for turn in fine), default=0.0)
        codes = ", ".join(f"{code} {count} times" for code, count in sorted(Counter(t.code for t in mine).items()))
        figures.append(
            f"{fault}: {len(fine)} of {len(mine)} equal; the slowest next apply took {slowest:.1f} s; "
            f"exit codes of the disturbed: {codes}"
        )
    return Result(
        "moments",
        ABOUT,
        figures,
        [
            "| fault | at event | exit code | steps left | next apply | end |",
            "|---|---|---|---|---|---|",
            *(turn.row() for turn in turns),
        ],
        seconds,
        left,
        sum(bool(turn.wrong) for turn in turns),
    )
