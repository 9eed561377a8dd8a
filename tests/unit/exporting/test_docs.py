"""The tables in the documentation are those of the code."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.exporting import kubernetes_classes, swarm_classes
from srprov.exporting.classes import EDF, Table

DOCS = Path(__file__).resolve().parents[3] / "docs"


def test_the_page_has_each_line_of_the_table() -> None:
    _, _, section = (DOCS / "from-compose.md").read_text().partition("## The way back")
    rows = [line for line in section.splitlines() if line.startswith("| `") and line.count("|") == 4]
    assert [f"| `{field}` | {kind} | {words} |" for field, (kind, words) in EDF.items()] == rows


@pytest.mark.parametrize(
    ("heading", "table"), [("Docker Swarm", swarm_classes.EDF), ("Kubernetes", kubernetes_classes.EDF)]
)
def test_the_page_of_clusters_has_each_line(heading: str, table: Table) -> None:
    _, _, after = (DOCS / "clusters.md").read_text().partition(f"## Fields in {heading}\n")
    section = after.partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| `") and line.count("|") == 4]
    assert [f"| `{field}` | {kind} | {words} |" for field, (kind, words) in table.items()] == rows
