"""Search the area together with the others: tell them what was seen, and go where nobody was.

Takes its number from its name, `robot-1` to `robot-4`. One whose number is above MEMBERS has nothing to do.
"""

import socket
import sys
import time

from area import CELLS, SIZE, Cell, goal, seen_from, start, step, target
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from fleet import MEMBERS, RELIABLE, SECOND, SEED, Go, Report, join, stopping

ME = int(socket.gethostname().rpartition("-")[2])
if ME > MEMBERS:
    print(f"idle: {MEMBERS} of the fleet search", flush=True)
    sys.exit(0)

participant, reports, starts = join()
writer = DataWriter(participant, reports, qos=RELIABLE)
reader = DataReader(participant, reports, qos=RELIABLE)
starter = DataReader(participant, starts, qos=RELIABLE)

places = {ME: start(ME)}
unseen = set(CELLS)
hidden = target(SEED)  # only looked at through what the robot sees


def listen() -> None:
    """Take what the others have said."""
    for report in reader.take(N=1000):
        if isinstance(report, Report) and report.robot != ME:
            places[report.robot] = report.x, report.y
            unseen.difference_update((cell % SIZE, cell // SIZE) for cell in report.seen)


def tell(second: int) -> bool:
    """Look around, tell the others what is new, and return whether the target is there."""
    x, y = places[ME]
    seen = seen_from(places[ME])
    new = [row * SIZE + column for column, row in sorted(seen & unseen)]
    unseen.difference_update(seen)
    others = sorted(places.keys() - {ME})
    writer.write(Report(robot=ME, second=second, x=x, y=y, seen=new, heard=others, found=hidden in seen))
    return hidden in seen


def wait_for_start() -> None:
    """Say where it is until the base has heard that all hear each other."""
    while not stopping.wait(0.05) and not any(isinstance(one, Go) for one in starter.take(N=10)):
        listen()
        tell(0)


def search() -> None:
    """Go on until the target is found, by whomever, or nothing is left."""
    begun, second = time.monotonic(), 0
    to: Cell | None = places[ME]
    while to and not stopping.wait(max(0.0, begun + (second + 1) * SECOND - time.monotonic())):
        listen()
        second += 1
        to = goal(ME, places, unseen)
        places[ME] = step(places[ME], to or places[ME])
        if tell(second):
            print(f"found the target at {hidden} after {second} s", flush=True)
            return
    print(f"stopped after {second} s at {places[ME]}", flush=True)


wait_for_start()
print(f"started at {places[ME]}; heard {sorted(places.keys() - {ME})}", flush=True)
search()
stopping.wait()  # what was said is kept for those who have not heard it yet
