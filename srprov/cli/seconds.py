"""The type of options that are times."""

from __future__ import annotations

import math
from typing import Any

import click

_LONGEST_S = 86_400.0


class Seconds(click.FloatRange):
    """A time of at most a day: a project's file may set one, and clocks and timers overflow far beyond it."""

    def __init__(self, min: float, *, min_open: bool = False) -> None:
        super().__init__(min=min, max=_LONGEST_S, min_open=min_open)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - as click has it
        """Return the seconds, or fail as click does; what is no number is not within any range."""
        seconds = super().convert(value, param, ctx)
        if math.isnan(seconds):
            self.fail(f"{value} is no time.", param, ctx)
        return seconds
