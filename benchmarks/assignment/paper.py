"""The paper's experiment on optimality and fairness: 12 workers, 6 services, 100 runs under a balanced load.

    python -m benchmarks.assignment.paper

The load is made up, since the paper gives no data but two numbers: the standard deviation (0.0156) and the coefficient
of variation (0.0066) of all costs, so a mean of 2.36. Each worker has a bias of its own and every run adds noise. A
second lab with uneven load (memory in use between 55 % and 95 %) shows what evenness costs where robots differ.
"""

from __future__ import annotations

import json
import statistics
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from srprov.assignment import fairness, problem, solve
from srprov.definitions.model import Experiment, Placement, Service
from srprov.facts.model import Docker, HostFacts, Snapshot

RESULTS = Path(__file__).parent / "results"
WORKERS, SERVICES, RUNS = 12, 6, 100
ALPHA = 20.0
PAPER = {"deviation": 0.0156, "variation": 0.0066, "workers": 7, "jain": 0.58}
LABS = {"balanced": (0.0016, 0.0004), "uneven": (0.08, 0.004)}
"""Lab -> relative bias per worker and noise per run, of memory in use."""
SETTINGS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)


@dataclass
class Result:
    """What 100 runs at one setting came to."""

    fairness: float
    total: float = 0.0
    least: float = 0.0
    """What the cheapest placement of every run would have cost."""
    costs: list[float] = field(default_factory=list)
    surface: list[list[float]] = field(default_factory=list)
    allocations: dict[str, int] = field(default_factory=dict)
    jain: list[float] = field(default_factory=list)


def robots(random: Random, bias: list[float], noise: float) -> Snapshot:
    """Return the workers of one run: about 83 % of memory in use, CPUs at 30 %, a 1 Gbit/s link at 5 %."""
    facts = {}
    for index in range(WORKERS):
        memory = 1_000_000
        used = min(0.98, 0.8268 * (1 + bias[index] + random.gauss(0, noise)))
        facts[f"worker{index + 1:02}"] = HostFacts(
            name=f"worker{index + 1:02}",
            arch="arm",
            cpus=4,
            load1=1.2 * (1 + random.gauss(0, noise)),
            memory_total=memory,
            memory_available=round(memory * (1 - used)),
            docker=Docker(version="27", api_version="1.46"),
            speed_mbit=1000.0,
            traffic_mbit=50.0,
        )
    return Snapshot(facts=facts, observed={})


def run(setting: float, lab: str, seed: int = 1) -> Result:
    """Make 100 runs, each with the history of those before."""
    random = Random(seed)
    spread, noise = LABS[lab]
    bias = [random.gauss(0, spread) for _ in range(WORKERS)]
    services = {f"service{n}": Service(name=f"service{n}", image="x", cost=ALPHA) for n in range(1, SERVICES + 1)}
    what = Experiment(
        name="paper", file="/e/paper.edf", folder="/e", services=services, placement=Placement(fairness=setting)
    )
    result, history = Result(setting), []
    for _ in range(RUNS):
        answer = solve.solve(problem.build(what, {}, robots(random, bias, noise), {}, history=history))
        shares = {answer.placed[name]: term.total for name, term in answer.terms.items()}
        history.append(shares)
        result.total += answer.cost
        result.least += answer.least
        result.jain.append(answer.jain)
        result.surface.append([cost for _, cost in sorted(answer.matrix["service1"].items()) if cost is not None])
        result.costs += result.surface[-1]
        for robot in shares:
            result.allocations[robot] = result.allocations.get(robot, 0) + 1
    return result


def row(result: Result) -> dict[str, Any]:
    """Return the figures of one setting."""
    deviation, mean = statistics.pstdev(result.costs), statistics.fmean(result.costs)
    return {
        "fairness": result.fairness,
        "deviation": deviation,
        "variation": deviation / mean,
        "workers": len(result.allocations),
        "jain": result.jain[-1],
        "total": result.total,
        "over_optimum": result.total / result.least - 1,
        "allocations": dict(sorted(result.allocations.items())),
        "jain_over_time": result.jain,
        "mean_cost_per_worker": [statistics.fmean(column) for column in zip(*result.surface, strict=True)],
    }


def markdown(rows: list[dict[str, Any]], lab: str) -> str:
    """Return the table of all settings, and the paper's figures beside those at 0."""
    lines = ["| | deviation of costs | coefficient of variation | workers used | Jain's index | above the optimum |"]
    lines += ["|---|---|---|---|---|---|"]
    lines += (
        []
        if lab != "balanced"
        else [
            f"| the paper | {PAPER['deviation']} | {PAPER['variation']} | {PAPER['workers']} "
            f"| about {PAPER['jain']} | |"
        ]
    )
    for one in rows:
        name = f"fairness {one['fairness']:g}" + (" (recommended)" if one["fairness"] == fairness.RECOMMENDED else "")
        lines.append(
            f"| {name} | {one['deviation']:.4f} | {one['variation']:.4f} | {one['workers']} | {one['jain']:.3f} |"
            f" {100 * one['over_optimum']:.3f} % |"
        )
    return "\n".join(lines) + "\n"


def plot(rows: list[dict[str, Any]], lab: str) -> None:
    """Draw allocations and mean costs, Jain's index over time, and the front."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4), layout="constrained")
    bars, time, front = figure.subplots(1, 3)
    shown = [one for one in rows if one["fairness"] in (0.0, fairness.RECOMMENDED)]
    for index, one in enumerate(shown):
        counts = [one["allocations"].get(f"worker{n + 1:02}", 0) for n in range(WORKERS)]
        where = [n + 0.4 * index - 0.2 for n in range(1, WORKERS + 1)]
        bars.bar(where, counts, width=0.4, label=f"fairness {one['fairness']:g}")
        time.plot(range(1, RUNS + 1), one["jain_over_time"], label=f"fairness {one['fairness']:g}")
    line = bars.twinx()
    line.plot(range(1, WORKERS + 1), shown[0]["mean_cost_per_worker"], "k.-", linewidth=0.7)
    line.set_ylabel("mean cost of a service (line)")
    bars.set(xlabel="worker", ylabel="services allocated in 100 runs (bars)")
    bars.legend()
    time.axhline(PAPER["jain"], color="grey", linestyle=":", label="the paper, about 0.58")
    time.set(xlabel="run", ylabel="Jain's index of summed costs", ylim=(0, 1.05))
    time.legend()
    front.plot([100 * one["over_optimum"] for one in rows], [one["jain"] for one in rows], "o-")
    for one in rows:
        front.annotate(
            f"{one['fairness']:g}",
            (100 * one["over_optimum"], one["jain"]),
            xytext=(4, -10),
            textcoords="offset points",
        )
    front.set(xlabel="cost above the optimum, %", ylabel="Jain's index after 100 runs", title="fairness")
    figure.savefig(RESULTS / f"paper-{lab}.svg", metadata={"Date": None})


def main() -> None:
    RESULTS.mkdir(exist_ok=True)
    labs = {lab: [row(run(setting, lab)) for setting in SETTINGS] for lab in LABS}
    (RESULTS / "paper.json").write_text(json.dumps(labs) + "\n")
    text = "\n".join(f"{lab} load\n\n{markdown(rows, lab)}" for lab, rows in labs.items())
    (RESULTS / "paper.md").write_text(text)
    print(text)
    for lab, rows in labs.items():
        plot(rows, lab)


if __name__ == "__main__":
    main()
