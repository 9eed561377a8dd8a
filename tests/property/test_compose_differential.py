"""Generated Compose projects: Docker Compose and we take the same ones, and make the same of them.

A hundred of them; two thousand with SRPROV_SOAK, or in the long profile.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, event, given, settings

from tests.compose_oracle import AVAILABLE, compose, differences, ours
from tests.conftest import PROFILE
from tests.property.compose_files import SETTINGS, Project, projects

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="Docker Compose is there for x86-64 only")
LONG = bool(os.environ.get("SRPROV_SOAK")) or PROFILE == "long"
EXAMPLES = int(os.environ.get("SRPROV_COMPOSE_EXAMPLES", "2000" if LONG else "100"))


@pytest.mark.timeout(3600)
@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
@given(projects())
def test_generated_projects_are_read_as_compose_reads_them(project: Project) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, text in project.files.items():
            (folder / path).parent.mkdir(exist_ok=True)
            (folder / path).write_text(text)
        theirs = compose(folder, project.main, profiles=project.profiles, settings=SETTINGS)
        mine, _ = ours(folder, project.main, profiles=project.profiles, settings=SETTINGS)
        event("refused" if theirs.refusal else "accepted")
        assert differences(theirs, mine) == []
