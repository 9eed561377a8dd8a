"""Plays runs to the live progress, as a program of its own on a terminal: `python -m tests.unit.cli.player N [N…]`.

One run for each number of robots, all of them at once in threads. `pause` instead of a number waits for a line on
standard input; `interrupt` sends Ctrl-C's signal in the middle of the next run.
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
LONG = "srprov/listener:f90d6563028b2b06 "


def step(run: int, robot: str, number: int) -> Any:
    """Return what progress reads of a step; every second one has a name that is wider than the terminal."""
    name = f"srprov.chatter-{run}.{robot}" + ("" if number % 2 else f"-{LONG.strip() * 4}")
    change = SimpleNamespace(action=Action.CREATE)
    return SimpleNamespace(
        number=number, host=robot, module="container", name=name, id=f"{robot}/{name}", change=change
    )


def play(robots: int, *, interrupt: bool) -> None:
    """Play one run."""
    record: Any = SimpleNamespace(event=lambda _value: None)
    plan: Any = SimpleNamespace(steps=range(robots * STEPS))
    stop = threading.Event()
    with progress(plan, record, events=None, color=True) as listen, soft_interrupt(stop):

        def one(robot: str) -> None:
            for number in range(STEPS):
                what = step(robots, robot, number)
                listen(Event(kind="start", host=robot, step=what))
                listen(Event(kind="progress", host=robot, step=what, text=f"Step 3/9 : RUN [/b] {LONG * 6}"))
                time.sleep(0.002)
                listen(Event(kind="waiting", host=robot, step=what, text=f"checking that services stay up {LONG * 3}"))
                listen(Event(kind="end", host=robot, step=what, outcome=Outcome.CHANGED))

        threads = [threading.Thread(target=one, args=(f"robot{n:02}",)) for n in range(robots)]
        for thread in threads:
            thread.start()
        if interrupt:
            os.kill(os.getpid(), signal.SIGINT)
        for thread in threads:
            thread.join()
        if robots % 10 in (0, 2):
            time.sleep(0.15)  # the status line is drawn by itself too
    err(f"run of {robots} done")


def main(words: list[str]) -> None:
    """Play what the words say."""
    interrupt = False
    for word in words:
        if word == "pause":
            err("paused")
            sys.stdin.readline()
        elif word == "interrupt":
            interrupt = True
        else:
            play(int(word), interrupt=interrupt)
            interrupt = False


if __name__ == "__main__":
    main(sys.argv[1:])
