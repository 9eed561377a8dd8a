"""All contestants, by the names that `--tools` takes."""

from __future__ import annotations

from benchmarks.provisioning.tool import Floor, Srprov, SrprovAtOnce, Tool

TOOLS: dict[str, type[Tool]] = {
    "floor": Floor,
    "srprov": Srprov,
    "srprov0": SrprovAtOnce,
}
