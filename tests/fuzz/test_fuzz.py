"""A minute of mutated files under the kernel's eye; `make soak` takes an hour (FUZZ_SECONDS says how long)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from srprov.cli.problems import render_problems
from srprov.definitions import check_files
from tests.fuzz.foreign import Kept
from tests.fuzz.surfaces import prepare, surfaces

SECONDS = float(os.environ.get("FUZZ_SECONDS", "60"))
# the same mutants in each run, as tests/conftest.py has it for examples; new ones are looked for by `make soak`
SEED = [] if "FUZZ_SECONDS" in os.environ else ["--seed", "1"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with a run and its bundle."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder / "state"))
        Kept.make(folder)
    return folder


def may_confine() -> bool:
    """Return whether this user may have a mount namespace."""
    words = ["unshare", "--mount", "--net", *([] if os.geteuid() == 0 else ["--map-root-user"]), "true"]
    try:
        return subprocess.run(words, check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        return False


@pytest.mark.timeout(SECONDS + 300)
@pytest.mark.skipif(not may_confine(), reason="no mount namespace for this user")
def test_mutated_files_are_read_or_refused_in_time_and_touch_nothing(kept: Path) -> None:
    """Each fault is one line, with the smallest input that has it in base64."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.fuzzer", str(SECONDS), *SEED],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, "\n".join(map(str, found)) + done.stderr
    assert set(found[-1]["inputs"]) == set(surfaces(kept)) and all(found[-1]["inputs"].values())


def test_what_is_mutated_is_right_before(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise each mutant would be refused for the same reason, and nothing beyond it be tried."""
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path)
    assert render_problems(check_files(["experiment.edf", "talker.cdf", "built/Dockerfile", "i.yml"])) == ""
    for name, one in surfaces(kept).items():
        for seed in one.seeds:
            prepare(tmp_path)
            one.use(tmp_path, seed.encode())
            if name in ("cdf", "base", "dockerfile", "env_file", "playbook"):
                assert render_problems(check_files(["experiment.edf"])) == "", name
