"""Colors of a plan: on what srprov wrote, not on what a value says; without them it is the same text."""

from __future__ import annotations

import click

from srprov.cli.plan_colors import painted

TEXT = """\
Instance hello (from here)

Placement
  web -> r1

r1
  - #1 volume srprov.hello.log: destroy  DATA IS LOST
  ± #2 container srprov.hello.web: command differs  [after #1]
      command: a -> b c
      environment.X: secret, changed
      volumes./f:
        @@ -1 +1 @@
        -old -> x
        +new

note: + #1 is not a step
Plan: 1 to replace, 1 to remove; 3 unchanged."""


def test_without_its_colors_it_is_the_same_text() -> None:
    """Nothing is added, left out or moved."""
    assert click.unstyle(painted(TEXT)) == TEXT
    assert painted(TEXT) != TEXT


def test_what_is_colored_is_what_changes() -> None:
    """Symbols, old and new values, lines of a diff, lost data; no title, note or placement."""
    lines = dict(zip(TEXT.split("\n"), painted(TEXT).split("\n"), strict=True))

    plain = {line for line, shown in lines.items() if line == shown}
    assert {"  web -> r1", "note: + #1 is not a step", "r1", "      environment.X: secret, changed"} <= plain
    assert lines["        +new"] == click.style("        +new", fg="green")
    assert lines["        -old -> x"] == click.style("        -old -> x", fg="red")
    old, new = click.style("a", fg="red"), click.style("b c", fg="green")
    assert lines["      command: a -> b c"] == f"      command: {old} -> {new}"
    assert click.style("DATA IS LOST", fg="red", bold=True) in painted(TEXT)
