"""Give the start when all robots hear each other, draw what they report, and end when one has found the target."""

import json
from collections.abc import Iterator
from pathlib import Path

from area import CELLS, SIZE, Cell
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from fleet import MEMBERS, RELIABLE, Go, Report, join, stopping

participant, topic, starts = join()
reader = DataReader(participant, topic, qos=RELIABLE)
starter = DataWriter(participant, starts, qos=RELIABLE)

seen_by: dict[Cell, int] = {}
"""Cell -> the first robot that reported it."""
twice: set[Cell] = set()
"""Cells that another one reported as new, too: the news of the first was still under way."""


def reports() -> Iterator[Report]:
    """Yield what robots say, as it comes."""
    while not stopping.wait(0.01):
        # a robot that leaves is reported as a sample without data
        yield from (one for one in reader.take(N=1000) if isinstance(one, Report))


def draw(report: Report) -> None:
    """Note which cells a robot says that it was the first to see."""
    for number in report.seen:
        cell = number % SIZE, number // SIZE
        if seen_by.setdefault(cell, report.robot) != report.robot:
            twice.add(cell)


def finish(report: Report) -> None:
    """Print the map, and write the result."""
    for row in range(SIZE):
        print("".join(str(seen_by.get((column, row), ".")) for column in range(SIZE)))
    result = {"time": report.second, "explored": 100 * len(seen_by) / len(CELLS), "twice": len(twice)}
    Path("/out/result.json").write_text(json.dumps(result), encoding="utf-8")
    print(f"robot {report.robot} found the target after {report.second} s", flush=True)


heard_by: dict[int, int] = {}
for said in reports():
    draw(said)
    if said.second == 0 and heard_by.get(said.robot) != len(said.heard):
        heard_by[said.robot] = len(said.heard)
        if list(heard_by.values()) == [MEMBERS - 1] * MEMBERS:
            print(f"{MEMBERS} in the fleet, and all hear each other: go", flush=True)
            starter.write(Go(members=MEMBERS))
    if said.found:
        finish(said)
        break
