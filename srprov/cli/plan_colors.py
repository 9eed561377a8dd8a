"""A plan's text with colors for a terminal: what is added, changed, removed; old and new lines of a file.

Takes text that is clean already. Colors follow from where srprov put a character, never from what stands in a value.
"""

from __future__ import annotations

import re

import click

_STEP = re.compile(r"  ([+~±!-]) #[0-9]")
_VALUE = re.compile(r"      (\S+): (.*) -> (.*)")
_DIFF = re.compile(r"        ([+@-])")
_OF_STEP = {"+": "green", "~": "yellow", "±": "magenta", "-": "red", "!": "cyan"}
_OF_LINE = {"+": "green", "-": "red", "@": "cyan"}


def painted(text: str) -> str:
    """Return a plan's text in color."""
    return "\n".join(map(_line, text.split("\n")))


def _line(line: str) -> str:
    if match := _STEP.match(line):
        symbol = click.style(match[1], fg=_OF_STEP[match[1]], bold=True)
        rest = line[3:].replace("DATA IS LOST", click.style("DATA IS LOST", fg="red", bold=True))
        return f"  {symbol}{rest}"
    if match := _DIFF.match(line):
        return click.style(line, fg=_OF_LINE[match[1]])
    if match := _VALUE.fullmatch(line):
        old, new = click.style(match[2], fg="red"), click.style(match[3], fg="green")
        return f"      {match[1]}: {old} -> {new}"
    return line
