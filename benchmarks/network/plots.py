"""Box plots of the network's measures, as the paper has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.dispersion import boxes
from benchmarks.network.measures import MEASURES, UNITS
from benchmarks.network.table import NAMES


def draw(values: Mapping[str, Mapping[str, Sequence[float | None]]], path: Path) -> None:
    """Draw a panel for each measure, with a box for each way."""
    panels = {
        f"{measure}, {UNITS[measure]}": {
            way: [value for value in values[measure][way] if value is not None]
            for way in NAMES
            if way in values[measure]
        }
        for measure in MEASURES
        if measure in values
    }
    boxes(panels, path)
