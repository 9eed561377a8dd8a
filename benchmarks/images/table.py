"""What is made of the measurements: medians, ratios and a Markdown table. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.provisioning.stats import ratio

Row = Mapping[str, Any]
CASES = ("fresh", "nothing", "changed", "two")
MEASURE = "save | load, at once"
"""The tool that ratios are to: the best that needs nothing but Docker and SSH."""
KEY = ("robots", "image_mib", "link", "case", "tool")
MIB = 1 << 20


def medians(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Return one row per lab, link, case and tool with medians and extremes, and what they are to others.

    `ratio` is to the seconds of `save | load` in the same case; `excess` is what each target received, in multiples of
    the compressed layers that it lacked. Failed runs are counted, and their figures left out.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in KEY), []).append(row)
    order = {key: index for index, key in enumerate(groups)}
    found = []
    for key in sorted(groups, key=lambda k: (k[2] != "full", k[1], k[0], CASES.index(k[3]), order[k])):
        good = [row for row in groups[key] if not row["problem"]]
        one: dict[str, Any] = dict(zip(KEY, key, strict=True))
        one |= {"runs": len(good), "failed": len(groups[key]) - len(good)}
        for name in ("seconds", "cpu", "rss_mib", "sent", "received", "per_robot", "missing"):
            one[name] = statistics.median(row[name] for row in good) if good else None
        one["least"] = min((row["seconds"] for row in good), default=None)
        one["most"] = max((row["seconds"] for row in good), default=None)
        one["excess"] = ratio(one["per_robot"], one["missing"])
        found.append(one)
    bases = {tuple(one[name] for name in KEY[:-1]): one["seconds"] for one in found if one["tool"] == MEASURE}
    for one in found:
        one["ratio"] = ratio(one["seconds"], bases.get(tuple(one[name] for name in KEY[:-1])))
    return found


def table(rows: Sequence[Row]) -> str:
    """Return a Markdown table of what `medians` gave."""
    lines = [
        "| robots | image MiB | link | case | tool | median s | least - most | times `save \\| load` | sent MiB "
        "| received MiB | per robot MiB | times the missing | controller CPU s | peak MiB | runs | failed |",
        "|---" * 16 + "|",
    ]
    for row in rows:
        cells = [row[name] for name in KEY[:-1]]
        cells += [row["tool"].replace("|", "\\|"), _number(row["seconds"])]
        cells += [f"{_number(row['least'])} - {_number(row['most'])}", _number(row["ratio"])]
        cells += [_mib(row[name]) for name in ("sent", "received", "per_robot")]
        cells += [
            _number(row["excess"]),
            _number(row["cpu"]),
            _number(row["rss_mib"], 0),
            row["runs"],
            row["failed"] or "",
        ]
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _mib(value: float | None) -> str:
    return "-" if value is None else f"{value / MIB:.1f}"
