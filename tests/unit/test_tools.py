"""The scripts below `tools/` and `.ci/` agree with the code that they prepare the machine for."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from srprov.lab.machine import IMAGE_PACKAGES, PACKAGES

ROOT = Path(__file__).resolve().parents[2]
SETUP = (ROOT / "tools/setup.sh").read_text()


def words(name: str) -> list[str]:
    """Give the words of one quoted assignment in setup.sh."""
    found = re.search(rf'^{name}="([^"]*)"', SETUP, re.MULTILINE)
    assert found, f"{name} is not in tools/setup.sh"
    return found[1].split()


def test_setup_installs_everything_that_the_lab_needs() -> None:
    installed = {pair.split(":")[1] for pair in words("PROGRAMS")} | set(words("PACKAGES"))
    assert set(PACKAGES.values()) | set(IMAGE_PACKAGES.values()) <= installed


@pytest.mark.parametrize("script", ["tools/setup.sh", "tools/demo.sh", ".ci/run"])
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
