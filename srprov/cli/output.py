"""The one place that prints. Everything a robot or a file said is stripped of control characters on its way out.

Answers go to standard output, all else to standard error, so that `--json` and pipes stay clean.
"""

from __future__ import annotations

import os
import re
from typing import TextIO

import click

_CONTROL = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Whole CSI sequences first, so that no `[31m` is left; then every C0 but newline and tab, DEL, and C1."""


def clean(text: str) -> str:
    """Give text that cannot move the cursor, change colours or retitle the terminal."""
    return _CONTROL.sub("", text)


def out(text: str) -> None:
    """Print an answer."""
    click.echo(clean(text))


def err(text: str, color: str | None = None) -> None:
    """Print progress, a note or an error; `color` is one of click's names and only srprov's own."""
    click.echo(click.style(clean(text), fg=color) if color else clean(text), err=True)


def wants_color(stream: TextIO) -> bool:
    """Tell whether a stream is a terminal that may be coloured; see no-color.org."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
