"""The manual's pages, done as they stand: files are written, commands typed, and what they print is compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.lab.conftest import Lab, part_of_lab
from tests.pages import ROOT, blocks, play

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
LONG = [
    path.relative_to(ROOT).as_posix()
    for path in sorted((ROOT / "docs").glob("*.md"))
    if any(block.kind == "run" for block in blocks(path))
]


def done(lab: Lab, folder: Path, page: str) -> None:
    """Do a page in a folder that has an inventory of three robots."""
    (folder / "inventory").mkdir()
    part_of_lab(lab, ROBOTS, folder / "inventory" / "lab.yml")
    play(ROOT / page, folder, {"SRPROV_LAB": lab.name})


@pytest.mark.soak
@pytest.mark.parametrize("page", LONG)
def test_the_page_of_the_manual_is_so(lab: Lab, tmp_path: Path, page: str) -> None:
    done(lab, tmp_path, page)
