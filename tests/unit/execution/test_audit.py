"""The audit log of a robot: one line per run that changed it, best effort, never a reason to fail."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from srprov.codes import Code
from srprov.errors import TransportError
from srprov.execution import audit as audits
from srprov.execution.audit import AuditEntry, audit
from srprov.execution.outcome import Outcome, StepResult
from srprov.execution.robot import RobotExecutor
from srprov.planning.plan import Step
from srprov.resource import Action, Change
from srprov.wire import Reply, Run

ENTRY = AuditEntry(run="20261121T090507Z-hello-0123abcd", owner="ada@desk", verb="apply", instance="hello")


class Session:
    """A robot that runs scripts here, or fails as told."""

    def __init__(self, failure: Exception | Reply | None = None) -> None:
        self.failure, self.scripts = failure, list[str]()

    def execute(self, command: Run, _progress: Any = None) -> Reply:
        self.scripts.append(command.script)
        if isinstance(self.failure, Exception):
            raise self.failure
        if self.failure is not None:
            return self.failure
        done = subprocess.run(["sh", "-c", command.script], capture_output=True, text=True, check=False)
        return Reply(status=done.returncode, out=done.stdout, err=done.stderr, ok=done.returncode == 0)


def results(*outcomes: tuple[str, Outcome, float]) -> list[StepResult]:
    """Return results of steps: robot, outcome, seconds."""
    change = Change(action=Action.RUN, cause="")
    return [
        StepResult(step=Step(number=n, host=host, module="file", name="x", change=change), outcome=outcome,
                   duration_s=took)
        for n, (host, outcome, took) in enumerate(outcomes, start=1)
    ]  # fmt: skip


def robots(**sessions: Session) -> dict[str, RobotExecutor]:
    """Return robots by name."""
    return {name: RobotExecutor(session, lambda _event: None) for name, session in sessions.items()}  # type: ignore[arg-type]


def test_a_line_per_changed_robot(tmp_path: Path) -> None:
    """Time in UTC, run, who, verb, instance and counts, appended; the file is 0640; an unchanged robot has none."""
    log = tmp_path / "srprov.log"
    one, other = Session(), Session()
    here = (("r1", Outcome.CHANGED, 0.1), ("r1", Outcome.CHANGED, 0.1), ("r1", Outcome.FAILED, 0.1))
    done = results(*here, ("r1", Outcome.SKIPPED, 0.0), ("r2", Outcome.UNCHANGED, 0.1), ("r2", Outcome.FAILED, 0.0))
    with mock.patch.object(audits, "AUDIT_LOG", str(log)):
        for _ in range(2):
            assert audit(ENTRY, robots(r1=one, r2=other), done) == {}
    assert other.scripts == [], "a step that failed before its first command changed nothing"
    lines = log.read_text().splitlines()
    words = "run=20261121T090507Z-hello-0123abcd by=ada@desk verb=apply instance=hello changed=2 failed=1"
    assert len(lines) == 2
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ " + re.escape(words), lines[0])
    assert log.stat().st_mode & 0o777 == 0o640


def test_what_does_not_work_is_told_per_robot() -> None:
    """A full disk, a lost connection, a robot that is gone by now; the others get their line."""
    done = results(*((host, Outcome.CHANGED, 0.1) for host in ("full", "lost", "gone", "fine")))
    fine = Session(Reply(status=0))
    full = Session(Reply(status=2, err="sh: cannot create\n/var/log/srprov.log: full", ok=False))
    there = robots(
        full=full, lost=Session(TransportError("lost", "the connection was lost", code=Code.LOST)), fine=fine
    )
    assert audit(ENTRY, there, done) == {
        "full": "sh: cannot create /var/log/srprov.log: full",
        "lost": "the connection was lost",
        "gone": "it cannot be reached any more",
    }
    assert len(fine.scripts) == 1


@pytest.mark.parametrize("owner", ["a b", "x\nfake line", "$(id)", "`id`'\"", "ä@b"])
def test_no_word_of_the_controller_can_forge_a_line(tmp_path: Path, owner: str) -> None:
    """A user's or host's name stays one word on one line, and runs nothing."""
    log = tmp_path / "log"
    entry = AuditEntry(run="r", owner=owner, verb="apply", instance="i")
    with mock.patch.object(audits, "AUDIT_LOG", str(log)):
        assert audit(entry, robots(r=Session()), results(("r", Outcome.CHANGED, 1.0))) == {}
    (line,) = log.read_text().splitlines()
    assert len(line.split(" ")) == 7
    assert line.split(" ")[2] == "by=" + re.sub(r"[^!-~]", "_", owner)
