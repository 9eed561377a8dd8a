"""Plots of what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _figure(width: float, height: float) -> Figure:
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "srprov"
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def bars(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw the medians: a panel per scenario and latency, seconds over robots (logarithmic), a line per tool."""
    latencies = sorted({row["latency_ms"] for row in rows})
    scenarios = list(dict.fromkeys(row["scenario"] for row in rows))
    figure = _figure(4.2 * len(scenarios), 3.6 * len(latencies))
    panels = figure.subplots(len(latencies), len(scenarios), squeeze=False, sharex=True)
    tools = list(dict.fromkeys(row["tool"] for row in rows))
    for latency, line in zip(latencies, panels, strict=True):
        for scenario, panel in zip(scenarios, line, strict=True):
            for index, tool in enumerate(tools):
                mine = [
                    (row["robots"], row["seconds"])
                    for row in rows
                    if (row["tool"], row["scenario"], row["latency_ms"]) == (tool, scenario, latency)
                    and row["seconds"] is not None
                ]
                if mine:
                    panel.plot(*zip(*mine, strict=True), marker="o", color=f"C{index}", label=tool)
            panel.set(title=f"{scenario}, SSH latency {latency} ms", xlabel="robots", ylabel="seconds", yscale="log")
            panel.grid(True, which="both", linewidth=0.3)
    panels[0][0].legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def surfaces(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw seconds over robots and services: a panel per tool."""
    tools = list(dict.fromkeys(row["tool"] for row in rows))
    figure = _figure(5.5 * len(tools), 4.6)
    highest = max((row["seconds"] for row in rows), default=1.0)
    for index, tool in enumerate(tools):
        mine = [row for row in rows if row["tool"] == tool]
        panel: Any = figure.add_subplot(1, len(tools), index + 1, projection="3d")
        if len(mine) > 3:
            columns = [[row[name] for row in mine] for name in ("robots", "services", "seconds")]
            panel.plot_trisurf(*columns, cmap="viridis", vmin=0, vmax=highest, linewidth=0.2, edgecolor="grey")
        panel.set(title=tool, xlabel="robots", ylabel="services", zlabel="seconds", zlim=(0, highest * 1.05))
        panel.view_init(elev=22, azim=-125)
    figure.savefig(path, metadata={"Date": None})
