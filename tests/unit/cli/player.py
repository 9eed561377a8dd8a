"""Plays runs to the live progress, as a program of its own on a terminal: `python -m tests.unit.cli.player N [N…]`.

One run for each number of robots, all of them at once in threads. Behind `hold` a run waits in its middle for a line
on standard input; behind `interrupt` it gets Ctrl-C's signal.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any

from srprov.cli.interrupt import soft_interrupt
from srprov.cli.output import err
from srprov.cli.progress import progress
from srprov.execution import Event, Outcome
from srprov.resource import Action

STEPS = 2
SLOW = (2, 12, 30)
"""With so many robots, steps take long enough for the status line to be drawn by itself."""
HELD = "half of it is done"
LONG = "srprov/listener:f90d6563028b2b06 "


def step(run: int, robot: str, number: int) -> Any:
    """Return what progress reads of a step; every second one has a name that is wider than the terminal."""
    name = f"srprov.chatter-{run}.{robot}" + ("" if number % 2 else f"-{LONG.strip() * 4}")
    change = SimpleNamespace(action=Action.CREATE)
    return SimpleNamespace(
        number=number, host=robot, module="container", name=name, id=f"{robot}/{name}", change=change
    )


def play(robots: int, how: str) -> None:
    """Play one run."""
    names = [f"robot{number:02}" for number in range(robots)]
    plan: Any = SimpleNamespace(steps=[step(robots, name, number) for name in names for number in range(STEPS)])
    stop, go_on, half = threading.Event(), threading.Event(), threading.Barrier(robots + 1)
    with progress(plan, events=None, color=True) as listen, soft_interrupt(stop):

        def one(robot: str) -> None:
            for number in range(STEPS):
                what = step(robots, robot, number)
                listen(Event(kind="start", host=robot, step=what))
                listen(Event(kind="progress", host=robot, step=what, text=f"Step 3/9 : RUN [/b] {LONG * 6}"))
                if number and how == "hold":
                    half.wait()
                    go_on.wait()
                time.sleep(0.15 if robots in SLOW else 0.002)
                listen(Event(kind="waiting", host=robot, step=what, text=f"checking that services stay up {LONG * 3}"))
                listen(Event(kind="end", host=robot, step=what, outcome=Outcome.CHANGED))

        threads = [threading.Thread(target=one, args=(name,)) for name in names]
        for thread in threads:
            thread.start()
        if how == "interrupt":
            os.kill(os.getpid(), signal.SIGINT)
        elif how == "hold":
            half.wait()
            err(HELD)
            sys.stdin.readline()
            go_on.set()
        for thread in threads:
            thread.join()
    err(f"run of {robots} done")


def main(words: list[str]) -> None:
    """Play what the words say."""
    how = ""
    for word in words:
        if word in ("hold", "interrupt"):
            how = word
        else:
            play(int(word), how)
            how = ""


if __name__ == "__main__":
    main(sys.argv[1:])
