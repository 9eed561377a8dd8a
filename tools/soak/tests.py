"""Lab tests as a part of the soak: pytest in a process of its own, which has so long and no longer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.lab.conftest import ROOT, Lab
from tools.soak.laboratory import down, guarded

WORDS = ("-q", "-p", "no:cacheprovider", "-p", "tools.soak.outcomes")


@dataclass(frozen=True)
class Outcome:
    """What came of one test."""

    test: str
    end: str
    """`passed`, `failed`, `skipped` or `not run`."""
    seconds: float = 0.0
    """Of the test itself, without its fixtures."""
    why: str = ""
    said: dict[str, Any] = field(default_factory=dict)
    """Its recorded properties."""

    @property
    def fine(self) -> bool:
        return self.end == "passed"

    def row(self, *before: str) -> str:
        name = self.test.removeprefix("tests/lab/")
        why = " ".join(self.why.split())[:200].replace("|", "/")
        cells = [*before, f"`{name}`", f"{self.seconds:.1f} s", f"{self.end}: {why}" if why else self.end]
        return f"| {' | '.join(cells)} |"


def run(tests: Sequence[str], limit_s: float, wait_s: float, **env: str) -> tuple[list[Outcome], float]:
    """Run these tests in one session of pytest with the lab for itself; give each one's outcome, and the seconds."""
    with guarded(wait_s) as folder:
        begun = time.monotonic()
        outcomes = folder / "outcomes.jsonl"
        own = {"SRPROV_OUTCOMES": str(outcomes), "SRPROV_LAB_GUARD": str(folder / "guard"), **env}
        program = [sys.executable, "-m", "pytest", *WORDS, f"--basetemp={folder / 'pytest'}", *tests]
        process = subprocess.Popen(program, cwd=ROOT, env={**os.environ, **own}, start_new_session=True)
        try:
            process.wait(limit_s)
        except subprocess.TimeoutExpired:
            print(f"pytest is ended after {limit_s:g} s", flush=True)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait(30)
            down(Lab(folder))  # a session that ended by itself has done so
        told = outcomes.read_text(encoding="utf-8").splitlines() if outcomes.exists() else []
        seconds = time.monotonic() - begun
    return collected(tests, told), seconds


def collected(tests: Sequence[str], told: Sequence[str]) -> list[Outcome]:
    """Return each wanted test's outcome from what the plugin wrote; a name without `[...]` stands for all its cases."""
    phases: dict[str, list[dict[str, Any]]] = {}
    for line in told:
        phase = json.loads(line)
        phases.setdefault(phase["test"], []).append(phase)
    found = [_one(test, mine) for test, mine in phases.items()]
    return found + [Outcome(test, "not run") for test in tests if not any(belongs(one.test, test) for one in found)]


def belongs(test: str, wanted: str) -> bool:
    """Whether a test is the wanted one, or a case of it."""
    return test == wanted or test.startswith(f"{wanted}[")


def _one(test: str, phases: list[dict[str, Any]]) -> Outcome:
    seconds = sum(phase["seconds"] for phase in phases if phase["when"] == "call")
    bad = [phase for phase in phases if phase["outcome"] != "passed"]
    if bad:
        return Outcome(test, bad[0]["outcome"], seconds, bad[0]["why"], phases[-1]["said"])
    ended = phases[-1]["when"] == "teardown"
    return Outcome(test, "passed" if ended else "not run", seconds, "" if ended else "ended early", phases[-1]["said"])
