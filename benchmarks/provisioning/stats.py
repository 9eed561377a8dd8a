"""What is made of the measurements: medians, ratios, tables, slopes. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]
FLOOR = "floor"
SCENARIOS = ("fresh", "nothing", "changed")


def medians(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Return one row per (robots, latency, scenario, tool) with medians, extremes, and the ratio to the floor's median.

    The order is that of robots, latency and scenario; tools stand as they first came. Failed runs are counted, and
    their figures left out.
    """
    groups: dict[tuple[int, int, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["robots"], row["latency_ms"], row["scenario"], row["tool"]), []).append(row)
    order = {key: index for index, key in enumerate(groups)}
    found = []
    for key in sorted(groups, key=lambda k: (k[0], k[1], SCENARIOS.index(k[2]), order[k])):
        good = [row for row in groups[key] if not row["problem"]]
        one: dict[str, Any] = dict(zip(("robots", "latency_ms", "scenario", "tool"), key, strict=True))
        one |= {"runs": len(good), "failed": len(groups[key]) - len(good)}
        for name in ("seconds", "cpu", "rss_mib", "sent", "received"):
            one[name] = statistics.median(row[name] for row in good) if good else None
        one["least"] = min((row["seconds"] for row in good), default=None)
        one["most"] = max((row["seconds"] for row in good), default=None)
        found.append(one)
    floors = {(one["robots"], one["latency_ms"], one["scenario"]): one for one in found if one["tool"] == FLOOR}
    for one in found:
        floor = floors.get((one["robots"], one["latency_ms"], one["scenario"]))
        one["ratio"] = ratio(one["seconds"], floor["seconds"] if floor else None)
    return found


def ratio(value: float | None, base: float | None) -> float | None:
    """Return value/base, or None where one is missing."""
    return value / base if value is not None and base else None


def table(rows: Sequence[Row]) -> str:
    """Return a Markdown table of what `medians` gave."""
    lines = [
        "| robots | SSH latency | scenario | tool | median s | least - most | times floor "
        "| controller CPU s | peak MiB | sent KiB | received KiB | failed |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        spread = f"{_number(row['least'])} - {_number(row['most'])}"
        cells = [
            row["robots"],
            f"{row['latency_ms']} ms",
            row["scenario"],
            row["tool"],
            _number(row["seconds"]),
            spread,
            _number(row["ratio"]),
            _number(row["cpu"]),
            _number(row["rss_mib"], 0),
            _number(None if row["sent"] is None else row["sent"] / 1024, 0),
            _number(None if row["received"] is None else row["received"] / 1024, 0),
            f"{row['failed']} of {row['failed'] + row['runs']}" if row["failed"] else "",
        ]
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def phases(rows: Iterable[Row]) -> str:
    """Return a Markdown table of the medians of what srprov says itself: its phases, and its traffic per robot."""
    groups: dict[tuple[int, int, str, str], list[Row]] = {}
    for row in rows:
        if row.get("reported"):
            groups.setdefault((row["robots"], row["latency_ms"], row["scenario"], row["tool"]), []).append(row)
    reports = [row["reported"] for group in groups.values() for row in group]
    names = list(dict.fromkeys(name for report in reports for name in report["phases"]))
    if not names:
        return ""
    heads = ["robots", "SSH latency", "scenario", "tool", *(f"{name} s" for name in names), "all s"]
    heads += ["connections per robot", "round trips per robot", "sent KiB", "received KiB"]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for (robots, latency, scenario, tool), group in sorted(groups.items(), key=lambda g: (g[0][:2], g[0][3])):
        told = [row["reported"] for row in group]
        times = [_number(statistics.median(one["phases"].get(name, 0.0) for one in told)) for name in names]
        middle = {name: statistics.median(one[name] for one in told) for name in told[0] if name != "phases"}
        cells = [robots, f"{latency} ms", scenario, tool, *times, _number(middle["duration_s"])]
        cells += [_number(middle[name] / robots, 1) for name in ("connections", "round_trips")]
        cells += [_number(middle[name] / 1024, 0) for name in ("bytes_sent", "bytes_received")]
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def plane(points: Sequence[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Fit z = a + b x + c y by least squares; give (a, b, c).

    Raises:
        ValueError: The points do not determine a plane.
    """
    rows = [(1.0, x, y) for x, y, _ in points]
    matrix = [[sum(row[i] * row[j] for row in rows) for j in range(3)] for i in range(3)]
    right = [sum(row[i] * point[2] for row, point in zip(rows, points, strict=True)) for i in range(3)]
    base = _determinant(matrix)
    if abs(base) < 1e-9:
        raise ValueError("the points do not determine a plane")
    solved = [
        _determinant([[right[r] if c == k else matrix[r][c] for c in range(3)] for r in range(3)]) for k in range(3)
    ]
    return solved[0] / base, solved[1] / base, solved[2] / base


def _determinant(m: Sequence[Sequence[float]]) -> float:
    return (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    )


def line(points: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Fit y = a + b x by least squares; give (a, b).

    Raises:
        statistics.StatisticsError: Fewer than two points, or all at one x.
    """
    slope, intercept = statistics.linear_regression([x for x, _ in points], [y for _, y in points])
    return intercept, slope
