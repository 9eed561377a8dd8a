"""The scripts below `tools/` and `.ci/` agree with the code that they prepare the machine for."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from srprov.lab.machine import IMAGE_PACKAGES, PACKAGES
from tests import conftest as effort
from tools.soak import faults, races
from tools.soak.results import Result, write
from tools.soak.tests import Outcome, collected

ROOT = Path(__file__).resolve().parents[2]
SETUP = (ROOT / "tools/setup.sh").read_text()


def words(name: str) -> list[str]:
    """Return the words of one quoted assignment in setup.sh."""
    found = re.search(rf'^{name}="([^"]*)"', SETUP, re.MULTILINE)
    assert found, f"{name} is not in tools/setup.sh"
    return found[1].split()


def test_setup_installs_everything_that_the_lab_needs() -> None:
    installed = {pair.split(":")[1] for pair in words("PROGRAMS")} | set(words("PACKAGES"))
    assert set(PACKAGES.values()) | set(IMAGE_PACKAGES.values()) <= installed


@pytest.mark.parametrize("script", ["tools/setup.sh", "tools/demo.sh", "tools/evidence.sh", ".ci/run"])
def test_scripts_can_be_run_and_parse(script: str) -> None:
    path = ROOT / script
    assert os.access(path, os.X_OK)
    shell = path.read_text().splitlines()[0].split("/")[-1].split()[-1]
    subprocess.run([shell, "-n", str(path)], check=True)


def test_make_help_lists_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text()
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony
    shown = subprocess.run(["make", "-C", str(ROOT), "help"], check=True, capture_output=True, text=True).stdout
    assert sorted(phony[1].split()) == sorted(re.findall(r"^\s+make ([a-z-]+)", shown, re.MULTILINE))


def test_the_configured_paths_find_every_test() -> None:
    configured = re.search(r"^testpaths = (\[.*\])$", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert configured
    folders = {path for pattern in json.loads(configured[1]) for path in ROOT.glob(pattern)}
    tests = {path for path in (ROOT / "tests").rglob("test_*.py") if "cases" not in path.parts}
    assert [path for path in sorted(tests) if not folders & {path, *path.parents}] == []


def test_the_files_that_two_processes_begin_with_are_there() -> None:
    assert [name for name in effort.LONGEST if not (ROOT / "tests" / f"{name}.py").exists()] == []


def test_what_make_starts_keeps_what_it_compiles() -> None:
    """Otherwise each of the processes that tests start compiles all that it imports."""
    words = ["make", "-s", "-C", str(ROOT), "--eval", "shown: ; @env", "shown"]
    env = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    shown = subprocess.run(words, check=True, capture_output=True, text=True, env=env).stdout
    assert "PATH=" in shown and "PYTHONDONTWRITEBYTECODE" not in shown


def test_two_processes_take_files_of_the_lab_and_others_in_turn() -> None:
    files = [
        ROOT / "tests" / f"{name}.py" for name in ("unit/a", "unit/b", "unit/c", "unit/d", "lab/e", *effort.LONGEST[:1])
    ]
    place = effort.places(files)
    assert [one.stem for one in sorted(files, key=place.__getitem__)] == ["a", "test_survival", "b", "c", "e", "d"]


@pytest.mark.parametrize(
    ("profile", "most", "taken"), [("quick", 400, 50), ("quick", 60, 20), ("quick", 9, 9), ("long", 400, 400)]
)
def test_property_tests_take_few_examples_by_default(
    monkeypatch: pytest.MonkeyPatch, profile: str, most: int, taken: int
) -> None:
    monkeypatch.setattr(effort, "PROFILE", profile)
    assert effort.examples(most) == taken


def test_the_soak_makes_every_fault_of_the_table_by_tests_of_the_files_that_it_names() -> None:
    text = (ROOT / "docs/reliability.md").read_text()
    table = text[text.index("\n## Faults") : text.index("\n### Soak")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:2] == "| "]
    named = {row[0]: set(re.findall(r"test_[a-z]+\.py", row[-1])) for row in rows[1:]}
    assert named == {fault: {test.partition("::")[0] for test in tests} for fault, tests in faults.FAULTS.items()}
    assert sorted(test for _, tests in faults.in_order() for test in tests) == sorted(
        faults.path_of(test) for tests in faults.FAULTS.values() for test in tests
    ), "each is there (else `in_order` raises) and makes one fault"
    file, _, name = races.TEST.partition("::")
    assert f"\ndef {name}(" in (ROOT / file).read_text()


def phase(test: str, when: str, outcome: str = "passed", why: str = "") -> str:
    said = {"winner": "anna"}
    return json.dumps({"test": test, "when": when, "outcome": outcome, "seconds": 2.0, "why": why, "said": said})


def test_the_soak_tells_what_failed_and_what_was_not_run() -> None:
    """Only a test that passed to the end of its teardown has passed; what is stuck is counted as such."""
    told = [phase("t::a[1]", when) for when in ("setup", "call", "teardown")]
    told += [
        phase("t::a[2]", "setup"),
        phase("t::a[2]", "call", "failed", "TimeoutExpired: | x"),
        phase("t::b", "setup"),
    ]
    found = collected(["t::a", "t::b", "t::c"], told)
    assert [(one.test, one.end) for one in found] == [
        ("t::a[1]", "passed"),
        ("t::a[2]", "failed"),
        ("t::b", "not run"),
        ("t::c", "not run"),
    ]
    result = races.told(found, 60, 0)
    assert result.figures == [
        "1 of 4 races: exactly one winner (anna 1)",
        "3 stuck; the slowest race took 2.0 s",
    ]
    assert (result.wrong, result.fine) == (3, False)
    assert races.told(found[:1], 60, 0).fine and not races.told(found[:1], 60, 1).fine
    fault = next(iter(faults.FAULTS))
    failed = Outcome(faults.path_of(faults.FAULTS[fault][0]), "failed", why="a | b")
    result = faults.told([failed], 60, 0)
    assert result.figures[0] == f"0 of {len(faults.FAULTS)} faults: all their tests passed"
    assert result.table[-1].endswith("| failed: a / b |")
    assert not result.fine


def test_a_part_of_the_soak_leaves_what_the_others_wrote(tmp_path: Path) -> None:
    path = tmp_path / "results.md"
    write(path, Result("races", "about", ["50 of 50"], ["| a |", "|---|", "| 1 |"], 120, 0, 0))
    first = path.read_text()
    write(path, Result("faults", "about", ["3 of 15"], ["| b |"], 60, 2, 0))
    both = path.read_text()
    assert both.index("ended early: 2") < both.index("- 3 of 15") < both.index("- 50 of 50") < both.index("| 1 |")
    assert "2 of 3 parts, 3 min" in both
    write(path, Result("faults", "about", [], [], 0, 0, 0))
    assert "1 of 3 parts, 2 min" in first and "| b |" not in path.read_text() and "| 1 |" in path.read_text()
