"""From definitions and facts to the answer, all of it: 1000 services on 1000 robots, and a second decision.

python -m benchmarks.assignment.whole
"""

from __future__ import annotations

import json
import statistics
import time
from pathlib import Path
from random import Random

from srprov.assignment import problem, solve
from srprov.definitions.containermodel import Requirements
from srprov.definitions.model import Experiment, Service
from srprov.facts.model import Docker, HostFacts, Snapshot

RESULTS = Path(__file__).parent / "results"
SIZE = 1000


def world(seed: int) -> tuple[Experiment, Snapshot]:
    random = Random(seed)
    services = {
        f"s{n:04}": Service(
            name=f"s{n:04}",
            image="x",
            cost=round(random.uniform(1, 100), 2),
            requires=Requirements(tags=(random.choice("abc"),), memory=random.choice((0, 1 << 30))),
        )
        for n in range(SIZE)
    }
    facts = {
        f"r{n:04}": HostFacts(
            name=f"r{n:04}",
            arch="amd64",
            cpus=4,
            load1=random.uniform(0, 4),
            memory_total=8 << 30,
            memory_available=int(random.uniform(0, 8) * (1 << 30)),
            tags=tuple(tag for tag in "abc" if random.random() < 0.7) or ("a",),
            docker=Docker(version="27", api_version="1.46"),
            speed_mbit=random.choice((54.0, 1000.0)),
        )
        for n in range(SIZE)
    }
    what = Experiment(name="whole", file="/e/whole.edf", folder="/e", services=services)
    return what, Snapshot(facts=facts, observed={})


def main() -> None:
    rows = []
    for seed in (1, 2, 3):
        what, found = world(seed)
        begun = time.perf_counter()
        task = problem.build(what, {}, found, {})
        built = time.perf_counter()
        answer = solve.solve(task)
        solved = time.perf_counter()
        again = solve.solve(problem.build(what, {}, found, answer.placed))
        assert again.placed == answer.placed
        rows.append({"build": built - begun, "solve": solved - built, "again": time.perf_counter() - solved})
        assert answer.optimal
    medians = {key: round(statistics.median(row[key] for row in rows), 3) for key in rows[0]}
    (RESULTS / "whole.json").write_text(json.dumps({"size": [SIZE, SIZE], "median_seconds": medians}) + "\n")
    print(medians)


if __name__ == "__main__":
    main()
