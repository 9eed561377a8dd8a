"""How many examples property tests take, and in which order two processes take the files.

Few examples by default, many with HYPOTHESIS_PROFILE=long, as `make soak` has it.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "quick")
LEAST = 20


def examples(most: int) -> int:
    """Return how many examples a test takes that takes `most` in the long profile: a quarter, but not too few."""
    return most if PROFILE == "long" else max(min(most, LEAST), most // 4)


settings.register_profile("quick", deadline=None, max_examples=examples(100))
settings.register_profile("long", deadline=None, max_examples=100)
settings.load_profile(PROFILE)

LONGEST = ["test_examples", "test_failures", "test_changes", "test_drift", "test_faults", "test_lab_faults"]
"""Files of tests/lab by how long they take; the others are shorter."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is too long for every day, unless SRPROV_SOAK asks for it.

    With pytest-xdist, begin with the longest files: whoever begins one last keeps the other process waiting.
    """
    long = [] if os.environ.get("SRPROV_SOAK") else [item for item in items if item.get_closest_marker("soak")]
    if long:
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: _place(item.path))


def _place(path: Path) -> tuple[bool, int]:
    in_lab = path.parent.name == "lab" and path.parent.parent.name == "tests"
    return not in_lab, LONGEST.index(path.stem) if path.stem in LONGEST else len(LONGEST)
