"""Pages of `srprov report` in a real browser without a network: nothing is loaded, nothing is said, axe finds no fault.

Chromium is Debian's; what drives it and axe-core are fetched by npm, each at one version; a long test therefore.
Pictures of the pages are left in build/report.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from tests.unit.report.records import run as a_run
from tests.unit.report.records import write

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium")
MODULES = ("axe-core@4.14.1", "puppeteer-core@24.31.0")
HOSTILE = "</title><script>alert(1)</script>\" onload='x'\u202e" + "w" * 60

pytestmark = [
    pytest.mark.soak,
    pytest.mark.timeout(1800),  # a page of 100 robots, eight times by axe, on a machine that others use, too
    pytest.mark.skipif(not (CHROMIUM and shutil.which("npm")), reason="needs Chromium, Node.js and npm"),
]


def pages(folder: Path) -> list[Path]:
    """Make a page of each kind."""
    empty: dict[str, Any] = a_run(3)
    empty["result.json"] |= {"changed": 0, "unchanged": 28, "steps": []}
    empty["plan.json"] |= {"steps": [], "counts": {"create": 0}, "unchanged": 28, "data": [], "permissions": []}
    killed = {name: content for name, content in a_run(4).items() if name not in ("result.json", "probe.json")}
    (folder / "plan.json").write_text(json.dumps(a_run(12)["plan.json"]))
    about = {
        "run": write(folder / "twelve", a_run(12, 12)),
        "failed": write(folder / "failed", a_run(12, failed=True)),
        "empty": write(folder / "empty", {**empty, "events.jsonl": ""}),
        "killed": write(folder / "killed", killed),
        "hundred": write(folder / "hundred", a_run(100)),
        "hostile": write(folder / "hostile", a_run(3, word=HOSTILE, failed=True)),
        "plan": folder / "plan.json",
        "trials": ROOT / "docs/evidence/race.zip",
    }
    for name, source in about.items():
        assert run(["report", str(source), "-o", str(folder / f"{name}.html")]) == 0
    return [folder / f"{name}.html" for name in about]


def test_pages_load_nothing_and_have_no_fault_in_both_schemes(tmp_path: Path) -> None:
    fetch = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(tmp_path)]
    subprocess.run([*fetch, *MODULES], check=True, timeout=300)
    pictures = ROOT / "build/report"
    pictures.mkdir(parents=True, exist_ok=True)
    made = pages(tmp_path)
    script = ROOT / "tests/integration/browser.mjs"
    command = ["node", str(script), str(CHROMIUM), str(tmp_path / "node_modules"), str(pictures), *map(str, made)]
    found = json.loads(subprocess.run(command, check=True, timeout=1500, stdout=subprocess.PIPE).stdout)
    assert sorted(found) == sorted(one.stem for one in made)
    for name, said in found.items():
        assert {one.partition("?")[0] for one in said["requests"]} == {(tmp_path / f"{name}.html").as_uri()[:100]}, name
        assert (said["messages"], said["policy"]) == ([], 0), name
        assert {way: faults for way, faults in said["violations"].items() if faults} == {}, name
        assert len(said["violations"]) == 8 and said["rules"] >= 10, "axe looked"
        assert {way: more for way, more in said["wide"].items() if more > 0} == {}, f"{name} is wider than its window"
        assert said["hidden"] == 0, f"{name}: folded when printed"
        assert said.get("keyboard", True) is True, name
    assert (tmp_path / "run.html").stat().st_size < 300_000
