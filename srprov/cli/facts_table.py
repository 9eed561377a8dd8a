"""The table of `srprov facts`: one line for each robot, those that cannot be reached at their place.

Takes HostFacts and reasons; gives text. Pure and independent of the terminal: columns are as wide as their longest
cell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from srprov.facts.model import HostFacts

_SHOWN_DEVICES = 4
_UNKNOWN = "?"


def _used(used: int, total: int) -> str:
    """Return `1.2/7.6 GiB`; nothing when there is none."""
    return f"{used / 2**30:.1f}/{total / 2**30:.1f} GiB" if total else ""


def _bandwidth(facts: HostFacts) -> str:
    if facts.speed_mbit <= 0:
        return _UNKNOWN
    return f"{max(0.0, facts.speed_mbit - facts.traffic_mbit):.0f}/{facts.speed_mbit:.0f}"


def _devices(devices: Sequence[str]) -> str:
    shown = [path.removeprefix("/dev/") for path in devices[:_SHOWN_DEVICES]]
    more = len(devices) - len(shown)
    return ",".join(shown) + (f" +{more}" if more else "")


_COLUMNS: tuple[tuple[str, Callable[[HostFacts], str], bool], ...] = (
    ("STATE", lambda f: "ok" if f.docker else "no Docker", False),
    ("ARCH", lambda f: f.arch, False),
    ("CPUS", lambda f: str(f.cpus), True),
    ("LOAD", lambda f: f"{f.load1:.2f}", True),
    ("MEMORY", lambda f: _used(f.memory_total - f.memory_available, f.memory_total), True),
    ("SWAP", lambda f: _used(f.swap_total - f.swap_free, f.swap_total), True),
    ("MBIT/S", _bandwidth, True),
    ("DOCKER", lambda f: f.docker.version + (" rootless" if f.docker.rootless else "") if f.docker else "", False),
    ("KERNEL", lambda f: f.kernel, False),
    ("CLOCK", lambda f: f"{f.clock_offset_s:+.2f} s", True),
    ("TAGS", lambda f: ",".join(f.tags), False),
    ("DEVICES", lambda f: _devices(f.devices), False),
)
"""(heading, cell, aligned right)"""


def facts_table(facts: Mapping[str, HostFacts], unreachable: Mapping[str, str]) -> str:
    """Return the table in name order, heading first; lines end with a line feed, and an empty cell is `-`.

    MEMORY and SWAP are used/total, MBIT/S is free/link speed of the underlay. Why a robot has no engine stands below
    the table; why one cannot be reached is told beside it, as by every verb.
    """
    names = sorted(facts.keys() | unreachable.keys())
    rows = [["ROBOT", *(heading for heading, _, _ in _COLUMNS)]]
    for name in names:
        found = facts.get(name)
        cells = [cell(found) for _, cell, _ in _COLUMNS] if found else ["unreachable", *[""] * (len(_COLUMNS) - 1)]
        rows.append([name, *(cell or "-" for cell in cells)])
    notes = [_note(name, reason) for name, reason in sorted(_reasons(facts).items())]
    return "\n".join([*_aligned(rows), *([""] if notes else []), *notes]) + "\n"


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    right = [False, *(to_right for _, _, to_right in _COLUMNS)]
    return [
        "  ".join(
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in rows
    ]


def _reasons(facts: Mapping[str, HostFacts]) -> dict[str, str]:
    return {name: f"no Docker Engine: {f.docker_problem}" for name, f in facts.items() if f.docker_problem}


def _note(name: str, reason: str) -> str:
    """Indent what follows the first line, so that a hint stays with its robot."""
    first, *others = reason.split("\n")
    return "\n".join([f"{name}: {first}", *(f"  {line.strip()}" for line in others)])
