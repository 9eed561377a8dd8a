"""A pytest plugin that writes down each test's outcome as soon as it is known: a run that is killed has told so far."""

from __future__ import annotations

import json
import os

import pytest


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    crash = getattr(report.longrepr, "reprcrash", None)
    why = "" if report.passed else str(crash.message if crash else report.longrepr)
    line = {
        "test": report.nodeid,
        "when": report.when,
        "outcome": report.outcome,
        "seconds": report.duration,
        "why": why,
        "said": dict(report.user_properties),
    }
    with open(os.environ["SRPROV_OUTCOMES"], "a", encoding="utf-8") as file:
        file.write(json.dumps(line, default=str) + "\n")
