"""What an engine says of one container of a trial -> a Reading. Pure.

Source: Docker Engine API 1.41, "Inspect a container".
"""

from __future__ import annotations

import datetime as dt
import re
from typing import Any

import msgspec

from srprov.untrusted import integer, mapping, string, text

_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(Z|[+-]\d\d:\d\d)", re.ASCII)
_NEVER = 0.0


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """One container at one moment; times are seconds since the epoch by its robot's clock, 0 for never."""

    state: str
    """`created`, `running`, `exited` …; empty when there is no such container."""
    exit_code: int = 0
    health: str = ""
    """`healthy`, `unhealthy`, `starting`, or nothing."""
    oom: bool = False
    restarts: int = 0
    started: float = 0.0
    finished: float = 0.0
    image: str = ""
    error: str = ""

    @property
    def ended(self) -> bool:
        """Whether its process has run and is over."""
        return self.state in ("exited", "dead") and self.finished > _NEVER


def read(answer: object) -> Reading:
    """Return what stands in an engine's answer."""
    body = mapping(answer)
    state: Any = mapping(body.get("State"))
    if not state:
        return Reading(state="")
    return Reading(
        state=text(state.get("Status")),
        exit_code=integer(state.get("ExitCode"), high=1 << 31),
        health=text(mapping(state.get("Health")).get("Status")).replace("none", ""),
        oom=state.get("OOMKilled") is True,
        restarts=integer(body.get("RestartCount"), high=1 << 31),
        started=engine_time(string(state.get("StartedAt"))),
        finished=engine_time(string(state.get("FinishedAt"))),
        image=string(body.get("Image")),
        error=text(state.get("Error"), length=400),
    )


def engine_time(said: str) -> float:
    """Return an engine's time in seconds since the epoch; 0 for "never", and for what is no time."""
    match = _TIME.fullmatch(said)
    if match is None:
        return _NEVER
    try:
        whole = dt.datetime.fromisoformat(match[1] + match[3].replace("Z", "+00:00")).timestamp()
    except (ValueError, OverflowError):
        return _NEVER
    return max(_NEVER, whole + float(f"0.{match[2] or 0}"))
