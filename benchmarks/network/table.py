"""What is made of the measurements: losses beside the paper's, and what the arithmetic of headers says. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.dispersion import Spread, loss, loss_of_means, spread
from benchmarks.network.link import Link
from benchmarks.network.measures import MEASURES, UDP_HEADERS, UNITS

Values = Mapping[str, Mapping[str, Sequence[float | None]]]
"""Measure -> way -> what each repetition gave."""
NATIVE = "native"
NAMES = {
    "native": "native",
    "host": "container, the robot's network",
    "overlay": "container, srprov's overlay",
    "wireguard": "container, srprov's overlay in WireGuard",
    "swarm": "container, Docker Swarm's overlay",
}
PAPER_RUNS = 100
PAPER = {
    "TCP_RR": ((57.1165, 0.1280), (51.5990, 0.1237), 5.64),
    "UDP_RR": ((78.3588, 0.1806), (83.4594, 0.2029), 5.45),
    "TCP_STREAM": ((12.4611, 0.1280), (12.3056, 0.1279), 1.12),
    "UDP_STREAM": ((14.5790, 0.1425), (14.2138, 0.1469), 5.76),
}
"""Measure -> deviation and CV, native and in containers, and the loss in percent, as the paper gives them."""
ETHERNET = 14
VXLAN = 50
"""Ethernet inside (14), VXLAN (8), UDP (8), IPv4 (20)."""
WIREGUARD = 60
"""Header (16) and tag (16), UDP (8), IPv4 (20)."""
_TCP_HEADERS = 52
"""IPv4 (20), TCP (20), its time stamps (12)."""
AROUND = {"native": 0, "host": 0, "overlay": VXLAN, "swarm": VXLAN, "wireguard": VXLAN + WIREGUARD}
"""Way -> bytes around each IP packet, beside the Ethernet header that all have."""


def share(measure: str, way: str, mtu: int) -> float:
    """Return the share of a full frame on the wire that is the user's data."""
    headers = _TCP_HEADERS if measure == "TCP_STREAM" else UDP_HEADERS
    return (mtu - headers) / (mtu + AROUND[way] + ETHERNET)


def least(measure: str, way: str, mtus: Mapping[str, int]) -> float | None:
    """Return the loss in percent that headers alone cause where the link's bytes are the limit; None for RR."""
    if measure not in ("TCP_STREAM", "UDP_STREAM"):
        return None
    return 100 * (1 - share(measure, way, mtus[way]) / share(measure, NATIVE, mtus[NATIVE]))


def paper(measure: str) -> tuple[Spread, Spread, tuple[float, float]]:
    """Return what the paper measured, native and in containers, and the loss of these means with its 95 % interval.

    The means are not in the paper: they are deviation / CV.
    """
    one, other = (Spread(PAPER_RUNS, 0, given[0] / given[1], given[0]) for given in PAPER[measure][:2])
    return one, other, loss_of_means(one, other)


def rows(values: Values, mtus: Mapping[str, int], link: Link) -> list[dict[str, Any]]:
    """Return a row for each measure and way that was measured."""
    found = []
    for measure in (one for one in MEASURES if one in values):
        base = values[measure][NATIVE]
        native = spread(base)
        for way in (name for name in NAMES if name in values[measure]):
            one = spread(values[measure][way])
            if one is None or native is None:
                continue
            row: dict[str, Any] = {"measure": measure, "way": way, "runs": one.count, "failed": one.failed}
            row |= {"mean": one.mean, "deviation": one.deviation, "variation": one.variation}
            if way != NATIVE:
                row["loss"] = loss(base, values[measure][way])
                row["least"] = least(measure, way, mtus) if link.rate_mbit else None
                if measure.endswith("_RR"):
                    row["added_us"] = 1e6 / one.mean - 1e6 / native.mean
            found.append(row)
    return found


def table(found: Sequence[Mapping[str, Any]], beside: bool) -> str:
    """Return a Markdown table; beside the paper's where the link is like the paper's."""
    head = [
        "",
        "unit",
        "mean",
        "deviation",
        "CV",
        "runs",
        "loss, % (95 %)",
        "by headers alone, %",
        "added per transaction, us",
    ]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for measure in MEASURES:
        mine = [row for row in found if row["measure"] == measure]
        lines += [_line(row) for row in mine]
        if beside and mine:
            lines += _paper_lines(measure)
    return "\n".join(lines) + "\n"


def verdicts(found: Sequence[Mapping[str, Any]]) -> str:
    """Return a Markdown table of srprov's losses beside the paper's, and whether they are at most those."""
    lines = ["| loss, % | the paper | srprov's overlay | by headers alone | |", "|---|---|---|---|---|"]
    for row in found:
        if row["way"] != "overlay" or row["loss"] is None:
            continue
        limit, least_loss = PAPER[row["measure"]][2], row["least"]
        said = "at most the paper's"
        if row["loss"][0] > limit:
            said = "more than the paper's"
            said += ", which is less than headers cost" if least_loss is not None and least_loss > limit else ""
        cells = [row["measure"], f"{limit:.2f}", _loss(row["loss"]), _plain(least_loss, 2), said]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _line(row: Mapping[str, Any]) -> str:
    runs = f"{row['runs']}" + (f", {row['failed']} failed" if row["failed"] else "")
    cells = [f"{row['measure']}, {NAMES[row['way']]}", UNITS[row["measure"]], _number(row["mean"])]
    cells += [_number(row["deviation"]), f"{row['variation']:.4f}", runs]
    cells += [_loss(row.get("loss")), _plain(row.get("least"), 2), _plain(row.get("added_us"), 1)]
    return "| " + " | ".join(cells) + " |"


def _paper_lines(measure: str) -> list[str]:
    one, other, (_, half) = paper(measure)
    cells = []
    for name, found, given in (("native", one, PAPER[measure][0]), ("container", other, PAPER[measure][1])):
        figures = [_number(found.mean), _number(found.deviation), f"{given[1]:.4f}", f"{PAPER_RUNS}"]
        cells.append([f"*{measure}, the paper, {name}*", UNITS[measure], *figures])
    added = _plain(1e6 / other.mean - 1e6 / one.mean, 1) if measure.endswith("_RR") else ""
    cells[0] += ["", "", ""]
    cells[1] += [f"{PAPER[measure][2]:.2f} ± {half:.2f}", "", added]
    return ["| " + " | ".join(line) + " |" for line in cells]


def _loss(given: Sequence[float] | None) -> str:
    return "" if given is None else f"{given[0]:.2f} ± {given[1]:.2f}"


def _plain(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _number(value: float) -> str:
    return f"{value:.4g}" if value < 1000 else f"{value:.0f}"
