"""A run of trials: what each parameter did to each metric, as plots and numbers, and all attempts. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import median
from typing import Any

from srprov.report.html import NOTHING, Child, Html, el, join
from srprov.report.material import Material, TrialsView
from srprov.report.parts import Section, fold, outcome, table
from srprov.report.plot import figures, finite, in_order
from srprov.report.words import counted, moment, number, pointer
from srprov.trials.judge import COUNTED

_MOST_PLOTS = 12
_MOST_ROWS = 1000
_MOST_POINTS = 500
_MOST_COLUMNS = 40
"""Parameters, and metrics, that are shown; the data of the page has all."""
Row = Mapping[str, Any]


def trials(material: Material) -> list[Section]:
    """Return the sections of a run of trials; none for anything else."""
    view = material.trials
    if view is None:
        return []
    counted_rows = [row for row in view.rows if row["status"] in COUNTED]
    metrics, parameters = _names(view.rows, "m_"), _names(view.rows, "p_")
    numbers = [name for name in metrics if any(finite(row.get(name)) is not None for row in counted_rows)]
    plots = list(_plots(counted_rows, numbers or ["duration_s"], parameters))
    found = []
    if plots:
        body = join([el("div", plots, class_="plots"), _more_plots(numbers, parameters)])
        found.append(
            Section(id="plots", title="Metrics", body=join([body, *_sums(view, counted_rows, numbers, parameters)]))
        )
    found.append(Section(id="attempts", title="Attempts", body=join(_attempts(view, parameters, metrics))))
    return found


def _names(rows: Sequence[Row], begin: str) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row if name.startswith(begin)))[:_MOST_COLUMNS]


def _plots(rows: Sequence[Row], numbers: Sequence[str], parameters: Sequence[str]) -> Iterator[Html]:
    usable = [name for name in parameters if rows and all(isinstance(row.get(name), str) for row in rows)]
    wanted = [(name, over) for name in numbers for over in (*usable, "")]
    drawn = [one for one in wanted if any(finite(row.get(one[0])) is not None for row in rows)]
    for name, over in drawn[:_MOST_PLOTS]:
        words = f"over {over.removeprefix('p_')}" if over else "over the order of ending"
        yield el("div", el("h3", f"{_title(name)} {words}"), figures(rows, name, over)[0])


def _title(name: str) -> str:
    return name.removeprefix("m_")


def _more_plots(numbers: Sequence[str], parameters: Sequence[str]) -> Html:
    whole = max(1, len(numbers)) * (max(1, len(parameters)) + 1)
    if whole <= _MOST_PLOTS:
        return NOTHING
    return el("p", "Other plots: srprov runs show RUN --svg FILE --metric NAME --over PARAMETER.", class_="soft")


_SUMS = ("trials", "median", "mean", "least", "most", "standard deviation")


def _sums(view: TrialsView, rows: Sequence[Row], numbers: Sequence[str], parameters: Sequence[str]) -> Iterator[Html]:
    """Return for each metric its middle and spread at each point of the design."""
    places = [
        {word: at for at, word in enumerate(in_order({str(row.get(name, "")) for row in rows}))} for name in parameters
    ]
    for name in numbers:
        of: dict[tuple[str, ...], list[float]] = {}
        for row in rows:
            if (value := finite(row.get(name))) is not None:
                of.setdefault(tuple(str(row.get(one, "")) for one in parameters), []).append(value)
        points = sorted(of, key=lambda point: [at[word] for at, word in zip(places, point, strict=True)])
        body: list[list[Child]] = [[*(point or ("all",)), *_figures(of[point])] for point in points[:_MOST_POINTS]]
        head = [*([one.removeprefix("p_") for one in parameters] or ["point"]), *_SUMS]
        unit = view.units.get(_title(name), "")
        caption = f"{_title(name)}{f' in {unit}' if unit else ''}, of attempts that count"
        yield table(caption, head, body, numbers=range(len(head) - len(_SUMS), len(head)))


def _figures(values: Sequence[float]) -> list[Html]:
    mean = math.fsum(values) / len(values)
    spread = math.sqrt(math.fsum((one - mean) ** 2 for one in values) / (len(values) - 1)) if len(values) > 1 else None
    shown = (median(values), mean, min(values), max(values))
    last = NOTHING if spread is None else number(spread, f"{spread:.6g}")
    return [number(len(values)), *(number(one, f"{one:.6g}") for one in shown), last]


def _attempts(view: TrialsView, parameters: Sequence[str], metrics: Sequence[str]) -> Iterator[Html]:
    counts: dict[str, int] = {}
    for row in view.rows:
        counts[str(row["status"])] = counts.get(str(row["status"]), 0) + 1
    parts: list[Child] = []
    for status, count in sorted(counts.items()):
        parts += [" " if parts else "", outcome(status), f" {count}"]
    yield el("p", parts)
    if clocks := _clocks(view.rows):
        yield el("p", clocks, class_="soft")
    names = [*parameters, *metrics]
    head = ["trial", "attempt", "began", "status", "verdict", "took, s", *(one[2:] for one in names), "why"]
    body = [_attempt(at, row, names) for at, row in enumerate(view.rows[:_MOST_ROWS])]
    shown = table("In the order in which they ended", head, body, numbers=(1, 5), kind="long")
    more = len(view.rows) - _MOST_ROWS
    rest = el("p", f"and {more} more, in the data of this page", class_="soft") if more > 0 else NOTHING
    yield fold(f"All {counted(len(view.rows), 'attempt')}", shown, rest, is_open=len(view.rows) <= 40)


def _attempt(at: int, row: Row, names: Sequence[str]) -> list[Child]:
    said = str(row.get("reason") or "")
    cells: list[Child] = [
        el("code", str(row["trial"])), _shown(row.get("attempt"), at, "attempt"),
        moment(str(row.get("started_utc") or "")), outcome(str(row["status"])), str(row.get("verdict") or ""),
        _shown(row.get("duration_s"), at, "duration_s"),
    ]  # fmt: skip
    return [*cells, *(_shown(row.get(name), at, name) for name in names), said]


def _shown(value: object, at: int, name: str) -> Child:
    if isinstance(value, bool) or value is None:
        return "" if value is None else str(value)
    if isinstance(value, int | float):
        return number(value, f"{value:.6g}" if isinstance(value, float) else str(value), of=pointer("rows", at, name))
    return str(value)


def _clocks(rows: Sequence[Row]) -> str:
    errors = [value for row in rows if (value := finite(row.get("clock_error_ms"))) is not None]
    if not errors:
        return ""
    steps = sum(row.get("clock_step") is True for row in rows)
    set_ = f"{counted(steps, 'attempt')} with a clock that was set"
    return f"Robots' clocks are known to {max(errors):.2f} ms at worst; {set_}."
