"""The README's figures are those of the files that the benchmarks wrote."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from benchmarks.provisioning.compare import RESULTS, kept
from benchmarks.provisioning.quote import BEGIN, END, README, replaced, text


def test_the_readme_says_what_was_measured() -> None:
    readme = README.read_text(encoding="utf-8")
    assert replaced(readme, text(RESULTS)) == readme, "python -m benchmarks.provisioning.quote writes it anew"
    assert "| - |" not in text(RESULTS), "a tool was not measured, or calls itself otherwise"


def test_the_default_comes_before_what_has_to_be_asked_for() -> None:
    """A user who types nothing more than `apply` waits for 2 s, to see that new services stay up."""
    rows = [line.split(" | ")[0] for line in text(RESULTS).splitlines() if "srprov" in line and line.startswith("| ")]
    assert rows[:2] == ["| **srprov**, which watches new services for 2 s", "| srprov, `--settle 0`"]


def test_every_figure_outside_the_marks_is_gone_with_the_marks() -> None:
    assert replaced(f"a {BEGIN} old 1.5 s {END} b", "new") == f"a {BEGIN}\n\nnew\n{END} b"
    with pytest.raises(ValueError, match="unpack"):
        replaced("no marks", "new")


def test_a_figure_that_changes_is_noticed(tmp_path: Path) -> None:
    for file in RESULTS.glob("*.json"):
        (tmp_path / file.name).write_text(file.read_text())
    compared = json.loads((tmp_path / "provisioning.json").read_text())
    for row in compared["medians"]:
        row["seconds"] = None if row["seconds"] is None else row["seconds"] + 1
    (tmp_path / "provisioning.json").write_text(json.dumps(compared))
    assert text(tmp_path) != text(RESULTS)
    assert re.search(r"\*\*srprov\*\*.* s \(\d\.\d\d\)", text(RESULTS))


def test_a_lab_that_is_measured_again_replaces_its_earlier_runs(tmp_path: Path) -> None:
    def row(robots: int, latency: int, seconds: float) -> dict[str, float]:
        return {"robots": robots, "latency_ms": latency, "seconds": seconds}

    file = tmp_path / "provisioning.json"
    assert kept(file, [row(1, 0, 1.0)]) == []
    file.write_text(json.dumps({"runs": [row(1, 0, 1.0), row(1, 40, 2.0), row(4, 0, 3.0)]}))
    assert kept(file, [row(1, 0, 9.0)]) == [row(1, 40, 2.0), row(4, 0, 3.0)]
