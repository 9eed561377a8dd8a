"""The result of a probe, as JSON and as text. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from srprov.errors import visible
from srprov.probing.model import SERVICE, UNDERLAY, Round
from srprov.probing.pairs import MULTICAST, TCP, Pair


def document(
    found: Round, pairs: Sequence[Pair], causes: Sequence[Mapping[str, Any]], seconds: float
) -> dict[str, Any]:
    """Return the documented JSON (`srprov schema probe`)."""
    asked = found.request
    overlay = [one for one in pairs if one.source.kind != UNDERLAY]
    return {
        "instance": asked.instance,
        "ok": not causes and not found.lost,
        "mtu": asked.mtu,
        "duration_s": round(seconds, 3),
        "endpoints": [
            {"name": one.name, "kind": one.kind, "robot": one.robot, "service": one.service, "address": one.address}
            for one in asked.endpoints
        ],
        "pairs": [pair_json(one) for one in overlay],
        "underlay": [pair_json(one) for one in pairs if one.source.kind == UNDERLAY],
        "causes": list(causes),
        "left_out": dict(sorted(found.left_out.items())),
        "unreachable": dict(sorted(found.lost.items())),
    }


def pair_json(pair: Pair) -> dict[str, Any]:
    """Return one pair; what was not looked at is null."""
    one = pair.measured
    streams = pair.source.kind == SERVICE == pair.target.kind and one.received > 0
    return {
        "from": pair.source.name,
        "to": pair.target.name,
        "failed": list(pair.failed),
        "sent": one.sent,
        "received": one.received,
        "rtt_ms": [round(us / 1000, 3) for us in one.rtt_us] if one.received else None,
        "mtu": one.fits,
        "tcp": TCP not in pair.failed if streams else None,
        "multicast": MULTICAST not in pair.failed if streams and pair.heard is not None else None,
    }


def text(said: Mapping[str, Any]) -> str:
    """Return a document as lines: a table of robots, how much was lost, and what fails."""
    robots = sorted({one["robot"] for one in said["endpoints"]}, key=_natural)
    return "\n".join([*_matrix(robots, said), summary(said), *problems(said)])


def summary(said: Mapping[str, Any]) -> str:
    """Return the line that says how it went."""
    pairs = said["pairs"]
    works = [one for one in pairs if not one["failed"]]
    sent, received = (sum(one[key] for one in works) for key in ("sent", "received"))
    services = sum(one["kind"] == "service" for one in said["endpoints"])
    robots = len({one["robot"] for one in said["endpoints"]})
    line = (
        f"{visible(said['instance'])}: {len(works)} of {len(pairs)} pairs of {robots} robots and {services} services "
        f"reach each other: small, {said['mtu']} bytes, TCP, multicast"
    )
    if not works:
        return line
    middle = median(one["rtt_ms"][1] for one in works)
    most = max(one["rtt_ms"][2] for one in works)
    return f"{line}\nround trips: {middle:.2f} ms, at most {most:.2f} ms; lost: {sent - received} of {sent} packets"


def problems(said: Mapping[str, Any]) -> list[str]:
    """Return the lines that say what fails and why, and who was not probed."""
    lines = []
    for cause in said["causes"]:
        lines += [visible(cause["text"]), f"  {visible(cause['hint'])}"]
    lines += [f"not probed: {visible(name)}: {visible(why)}" for name, why in said["left_out"].items()]
    lines += [f"not probed: {visible(robot)}: {visible(why)}" for robot, why in said["unreachable"].items()]
    return lines


def _matrix(robots: Sequence[str], said: Mapping[str, Any]) -> list[str]:
    """Return a table with a line for each robot that asks: the longest round trip in ms, or what fails."""
    home = {one["name"]: one["robot"] for one in said["endpoints"]}
    cells: dict[tuple[str, str], tuple[list[str], float]] = {}
    for one in said["pairs"]:
        where = home[one["from"]], home[one["to"]]
        failed, most = cells.get(where, ([], 0.0))
        cells[where] = [*failed, *one["failed"]], max(most, one["rtt_ms"][1] if one["rtt_ms"] else 0.0)
    rows = [["from \\ to, ms", *robots]]
    for source in robots:
        rows.append([source, *(_cell(cells.get((source, target))) for target in robots)])
    widths = [max(len(visible(row[at])) for row in rows) for at in range(len(robots) + 1)]
    return ["  ".join(visible(cell).ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _cell(found: tuple[list[str], float] | None) -> str:
    if found is None:
        return "-"
    failed, most = found
    return failed[0] if failed else f"{most:.2f}"


def _natural(name: str) -> tuple[str, int]:
    digits = name[len(name.rstrip("0123456789")) :]
    return name[: len(name) - len(digits)], int(digits[:9] or 0)
