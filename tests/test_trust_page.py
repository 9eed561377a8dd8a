"""docs/trust.md names, for each attack, the test that shows what stops it: every one of them is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_NAMED = re.compile(r"`([\w/]+\.py)?::(test_\w+)")
_FILE = re.compile(r"`([\w/]+\.py)(?=[`:])")


def named() -> list[tuple[str, str]]:
    """Return file and name of each test; one without a file is in the last that its line names before it."""
    found = []
    for line in (ROOT / "docs/trust.md").read_text().splitlines():
        for match in _NAMED.finditer(line):
            before = [one[1] for one in _FILE.finditer(line, 0, match.start() + len(match[1] or "") + 2)]
            found.append((before[-1] if before else "", match[2]))
    return sorted({*found})


def test_there_are_some() -> None:
    assert len(named()) > 250


@pytest.mark.parametrize(("file", "name"), named())
def test_a_test_that_the_page_names_is_there(file: str, name: str) -> None:
    places = [path for path in (ROOT / "tests").rglob("*.py") if path.as_posix().endswith(f"/{file}")]
    assert any(f"def {name}(" in path.read_text() for path in places), places
