"""Generated Compose projects: each becomes an experiment that validates, or is refused at a place, and leaves nothing.

Sixty of them; two thousand with SRPROV_SOAK.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from hypothesis import HealthCheck, event, given, settings

from srprov.conversion import report
from srprov.conversion.compose import Wanted, draft
from srprov.conversion.experiment import Draft
from srprov.conversion.folder import write
from srprov.conversion.kept import Kept
from srprov.conversion.table import key_of, kinds, row_of
from srprov.definitions import check_files
from srprov.importing.normal import Refused
from tests.property.compose_files import SETTINGS, Project, projects

EXAMPLES = int(os.environ.get("SRPROV_COMPOSE_EXAMPLES", "2000" if os.environ.get("SRPROV_SOAK") else "60"))
FOLDERS = (".", "robot", "ctx", "config", "data", "sub", "d")
FILES = ("cfg", "secret.txt", "d/D", "Dockerfile.arm")


def laid_out(folder: Path, project: Project) -> list[str]:
    """Write a project with what its services build and mount; give its main files."""
    folder.mkdir()
    for name in FOLDERS:
        (folder / name).mkdir(exist_ok=True)
        (folder / name / "Dockerfile").write_text("FROM busybox AS base\nARG A\n")
    for name in FILES:
        (folder / name).write_text("FROM busybox\n")
    for path, text in project.files.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text)
    return [str(folder / name) for name in project.main]


def check_findings(found: Draft) -> None:
    for one in found.findings:
        assert one.at.file and one.at.line > 0 and one.at.column > 0
        row = row_of(key_of(tuple(int(part) if part.isdecimal() else part for part in one.key.split("."))))
        if row is not None and ".a.b." not in one.key:  # a name with a dot cannot be told from a key
            assert one.kept in kinds(row) | {Kept.EXACT}, f"{one.key} is {one.kept.value}: {one.message}"
    for text in (report.as_text(found), report.as_markdown(found, ["c.yaml"]), report.as_sarif(report.told(found))):
        assert text


@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
@given(projects())
def test_generated_projects_become_experiments_or_are_refused_at_a_place(project: Project) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, target = Path(name) / "in", Path(name) / "out"
        main = laid_out(folder, project)
        wanted = Wanted(
            files=main, folder=str(target), settings=SETTINGS, profiles=project.profiles, name="p", root=str(folder)
        )
        try:
            found = draft(wanted)
            check_findings(found)
            if not found.refused:
                write(found, str(target), main)
                assert check_files([target / "experiment.edf"], ("*",) if "profiles" in str(found.edf) else ()) == []
            event("refused" if found.refused else "written")
        except Refused as refused:
            event("refused as a whole")
            assert all(one.location.file.startswith(str(folder)) for one in refused.problems)
        assert sorted(one.name for one in Path(name).iterdir()) in (["in"], ["in", "out"])
