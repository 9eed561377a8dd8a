"""Jobs that cannot end: `job: true` beside a restart policy that starts them again whenever they do. Pure."""

from __future__ import annotations

from srprov.codes import Code
from srprov.definitions.model import Service
from srprov.yamldoc import nodes
from srprov.yamldoc.nodes import Findings, Map

_ENDLESS = ("always", "unless-stopped")


def check(entry: Map, one: Service, findings: Findings) -> None:
    """Add it where a service of the EDF, with what its CDF says, is such a job."""
    if not one.runtime.job or one.runtime.restart not in _ENDLESS:
        return
    key = next((name for name in ("restart", "job") if name in entry.entries), "")
    place = nodes.key_or_value(entry, key) if key else entry
    message = f"'{one.name}' is a job, and 'restart: {one.runtime.restart}' never lets it end"
    hint = "leave out 'restart', write 'restart: on-failure', or leave out 'job'"
    findings.add(place, message, ("services", one.name, *([key] if key else [])), hint, code=Code.EXCLUSIVE)
