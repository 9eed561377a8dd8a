"""Compose files as robots have them: we take what Docker Compose takes, and make the same of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.compose_oracle import AVAILABLE, compose, differences, ours

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="Docker Compose is there for x86-64 only")

CASES = sorted(path for path in (Path(__file__).resolve().parents[2] / "cases" / "compose").iterdir() if path.is_dir())
REFUSED = {
    "19-profile-is-off": "4:18",
    "21-duplicate-key": "6:3",
    "22-required-variable": "3:12",
    "23-unknown-key": "4:5",
    "24-network-and-mode": "4:19",
    "25-undefined-volume": "2:17",
    "26-port-ranges": "4:13",
    "27-dependency-circle": "2:17",
    "34-scale-and-name": "2:48",
    "45-health-wrong": "2:31",
    "48-two-of-one-name": "3:49",
    "46-bad-duration": "2:36",
    "47-tabs": "2:1",
}
"""Those that neither takes, and where ours says why."""


def choices(case: Path) -> dict[str, Any]:
    """Return what the command line says for a case; without `case.json`, nothing."""
    path = case / "case.json"
    said: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return {"files": ["compose.yml"], "profiles": [[], ["*"]], **said}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_file_of_robots_is_read_as_compose_reads_it(case: Path) -> None:
    said = choices(case)
    more = {"settings": said.get("settings", {}), "env_files": said.get("env_files", [])}
    for profiles in said["profiles"]:
        theirs = compose(case, said["files"], profiles=profiles, **more)
        mine, normal = ours(case, said["files"], profiles=profiles, **more)
        assert differences(theirs, mine) == []
        if case.name in REFUSED and not profiles:
            assert mine.refusal.startswith(f"{case / said['files'][0]}:{REFUSED[case.name]}: ")
        assert normal is not None or case.name in REFUSED


def test_there_are_as_many_as_promised() -> None:
    assert len(CASES) - len(REFUSED) >= 35
    assert len(CASES) >= 45
