"""The table in the documentation is the table of the code."""

from __future__ import annotations

from pathlib import Path

from srprov.exporting.classes import EDF

PAGE = Path(__file__).resolve().parents[3] / "docs" / "from-compose.md"


def test_the_page_has_each_line_of_the_table() -> None:
    _, _, section = PAGE.read_text().partition("## The way back")
    rows = [line for line in section.splitlines() if line.startswith("| `") and line.count("|") == 4]
    assert [f"| `{field}` | {kind} | {words} |" for field, (kind, words) in EDF.items()] == rows
