"""The manual lists as built only what is built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from srprov.definitions import load_experiment

DOCS = Path(__file__).parents[3] / "docs"


def first_column(page: str, heading: str) -> list[str]:
    """Return the words in backticks of a table's first column."""
    rows = (DOCS / page).read_text(encoding="utf-8").partition(heading)[2].strip().splitlines()
    cells = [row.split("|")[1] for row in rows[1 : next(at for at, row in enumerate(rows) if not row.startswith("|"))]]
    return [word for cell in cells for word in re.findall(r"`([^`]+)`", cell)]


@pytest.mark.parametrize("kind", first_column("network.md", "| a service's `network` | its name resolves to |\n"))
def test_every_kind_of_network_in_the_manual_is_built(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "e.edf"
    path.write_text(f"edf: 1\nname: x\nservices:\n  a: {{image: busybox, network: {kind}}}\n")
    assert load_experiment(str(path)).unsupported == ()


def test_every_kind_of_package_in_the_manual_is_built(tmp_path: Path) -> None:
    fields = re.findall(r"^\| \d+ \| `packages\.(\w+)`", (DOCS / "images.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert "apt" in fields
    path = tmp_path / "e.edf"
    path.write_text("edf: 1\nname: x\nservices:\n  a: {cdf: a.cdf}\n")
    packages = "".join(f"  {kind}: [x]\n" for kind in fields)
    (tmp_path / "a.cdf").write_text(f"cdf: 1\nname: a\nbase: debian:bookworm\npackages:\n{packages}")
    assert load_experiment(str(path)).unsupported == ()
