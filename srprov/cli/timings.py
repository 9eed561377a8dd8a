"""Where the time of a run went, as text: phases in their order, then robots, the slowest first.

Takes the documented JSON of a run; returns text. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_MOST = 20


def timings_text(phases: Mapping[str, float], robots: Mapping[str, Mapping[str, Any]]) -> str:
    """Return two tables; seconds of robots overlap with each other and with the phases."""
    width = max((len(name) for name in (*phases, *robots, "robot")), default=5)
    lines = ["", f"{'phase':<{width}}        s", *(f"{name:<{width}} {s:8.3f}" for name, s in phases.items())]
    lines += ["", f"{'robot':<{width}}  connect    asked    acted  round trips       sent   received"]
    slowest = sorted(robots, key=lambda name: (-_seconds(robots[name]), name))
    for name in slowest[:_MOST]:
        one = robots[name]
        lines.append(
            f"{name:<{width}} {one['connect_s']:8.3f} {one['asked_s']:8.3f} {one['acted_s']:8.3f} "
            f"{one['round_trips']:12d} {_size(one['bytes_sent']):>10} {_size(one['bytes_received']):>10}"
        )
    if len(slowest) > _MOST:
        lines.append(f"and {len(slowest) - _MOST} faster ones")
    return "\n".join(lines)


def _seconds(robot: Mapping[str, Any]) -> float:
    return float(robot["connect_s"] + robot["asked_s"] + robot["acted_s"])


def _size(count: int) -> str:
    return f"{count / 1024:.1f} KiB" if count < 1 << 20 else f"{count / (1 << 20):.1f} MiB"
