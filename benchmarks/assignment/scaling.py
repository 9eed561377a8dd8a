"""How long the exact answer takes, beside general solvers on the same instances in the same run.

python -m benchmarks.assignment.scaling [--quick]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.assignment import rivals
from benchmarks.assignment.instances import table
from srprov.assignment.solve_arrays import run
from srprov.assignment.table import ProblemTable

RESULTS = Path(__file__).parent / "results"
POOLED = ((50, 40, 15), (200, 150, 60), (400, 300, 100), (1000, 800, 300))
PLAIN = ((200, 200), (500, 500), (1000, 1000))
LIMIT_S = {50: 60.0, 200: 120.0, 400: 240.0, 1000: 120.0}


def ours(one: ProblemTable) -> rivals.Timed:
    begun = time.perf_counter()
    found = run(one)
    took = time.perf_counter() - begun
    return took, found.cost if found else None, bool(found and found.proved)


def compare(one: ProblemTable, others: dict[str, Callable[[ProblemTable], rivals.Timed]]) -> dict[str, Any]:
    """Time every solver on one instance; all that proved an optimum must agree to a millionth per service."""
    mine = ours(one)
    row: dict[str, Any] = {"srprov": {"seconds": mine[0], "cost": mine[1], "proved": mine[2]}}
    for name, solve in others.items():
        took, cost, proved = solve(one)
        row[name] = {"seconds": took, "cost": cost, "proved": proved, "ratio": took / mine[0]}
        if proved and mine[2] and (mine[1] is None or cost is None or abs(mine[1] - cost) > one.nodes):
            raise SystemExit(f"{name} found {cost}, srprov {mine[1]}: one of them is wrong")
    return row


def pooled(
    sizes: tuple[tuple[int, int, int], ...], kinds: tuple[str, ...], save: Callable[[dict[str, Any]], None]
) -> None:
    for kind in kinds:
        for robots, services, pools in sizes:
            limit = LIMIT_S[robots]
            for seed in (1, 2, 3, 4, 5) if robots < 1000 else (1, 2):
                one = table(kind, robots, services, pools, seed)
                others = {"highs": lambda t, limit=limit: rivals.general(t, "highs", limit)}
                if robots <= 50:
                    others["cp_sat"] = lambda t: rivals.general(t, "cp_sat", 10.0)
                save({"kind": kind, "size": [robots, services, pools], "seed": seed, **compare(one, others)})


def plain(sizes: tuple[tuple[int, int], ...], save: Callable[[dict[str, Any]], None]) -> None:
    for robots, services in sizes:
        for seed in (1, 2, 3, 4, 5):
            one = table("uniform", robots, services, 0, seed)
            others: dict[str, Callable[[ProblemTable], rivals.Timed]] = {
                "or_tools_flow": rivals.bare_flow,
                "scipy": rivals.scipy_assignment,
            }
            if robots <= 200 and seed == 1:
                others["networkx"] = rivals.networkx_flow
                others["highs"] = lambda t: rivals.general(t, "highs", 60.0)
            save({"kind": "uniform", "size": [robots, services, 0], "seed": seed, **compare(one, others)})


def summary(rows: list[dict[str, Any]]) -> str:
    """Return medians per kind and size as a Markdown table; what proved nothing in its time counts with its limit."""
    lines = [
        "| instances | robots x services x pools | solver | median s | times ours | proved |",
        "|---|---|---|---|---|---|",
    ]
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["kind"], "x".join(map(str, row["size"]))), []).append(row)
    for (kind, size), some in groups.items():
        for solver in dict.fromkeys(key for row in some for key, value in row.items() if isinstance(value, dict)):
            having = [row[solver] for row in some if solver in row]
            took = statistics.median(one["seconds"] for one in having)
            ratio = statistics.median(one.get("ratio", 1.0) for one in having)
            proved = f"{sum(one['proved'] for one in having)} of {len(having)}"
            lines.append(f"| {kind} | {size} | {solver} | {took:.3f} | {ratio:.2f} | {proved} |")
    return "\n".join(lines) + "\n"


def plot(rows: list[dict[str, Any]]) -> None:
    """Draw seconds against robots, both on logarithmic scales, a line per kind of instance and solver."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    lines: dict[str, dict[int, list[float]]] = {}
    for row in rows:
        kind = f"{row['kind']}, {'pools' if row['size'][2] else 'no pools'}"
        for solver, value in row.items():
            if isinstance(value, dict):
                lines.setdefault(f"{solver} ({kind})", {}).setdefault(row["size"][0], []).append(value["seconds"])
    for name, points in sorted(lines.items()):
        style = "o-" if name.startswith("srprov") else "x--"
        axes.loglog(sorted(points), [statistics.median(points[size]) for size in sorted(points)], style, label=name)
    axes.set(xlabel="robots", ylabel="seconds, median (or the time limit)")
    axes.legend(fontsize=7)
    figure.savefig(RESULTS / "scaling.svg", metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="only the smaller sizes")
    quick = parser.parse_args().quick
    rows: list[dict[str, Any]] = []
    RESULTS.mkdir(exist_ok=True)

    def save(row: dict[str, Any]) -> None:
        rows.append(row)
        print(json.dumps(row), flush=True)
        (RESULTS / "scaling.json").write_text(json.dumps(rows, indent=1) + "\n")
        (RESULTS / "scaling.md").write_text(summary(rows))

    run(table("loads", 10, 8, 3, 0))  # so that nobody pays for loading libraries
    plain(PLAIN, save)
    pooled(POOLED[:2] if quick else POOLED, ("loads",), save)
    pooled(POOLED[:2], ("uniform",), save)
    plot(rows)


if __name__ == "__main__":
    main()
