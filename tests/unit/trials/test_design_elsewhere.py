"""The design that the command line lists is that of a shell script, whatever seed Python's own hashes have."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
EDF = """\
edf: 1
name: race
services: {{a: {{image: "alpine:3"}}}}
parameters: {{SPEED: [{speeds}], PLANNER: [dwb, mppi], ZONE: [north, süd]}}
trials: {{repetitions: {repetitions}, seed: 2026, order: random, timeout: 5s}}
"""


def listed(folder: Path, speeds: str, repetitions: int, hash_seed: int) -> list[str]:
    """Return a line per trial by `srprov trials`."""
    path = folder / "race.edf"
    path.write_text(EDF.format(speeds=speeds, repetitions=repetitions), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": str(hash_seed)}
    done = subprocess.run(
        [sys.executable, "-m", "srprov", "trials", str(path), "--json"],
        env=environment, capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    return [f"{one['trial']} {one['seed']}" for one in json.loads(done.stdout)["trials"]]


def by_shell(speeds: str, repetitions: int) -> list[str]:
    parameters = f"SPEED {speeds.replace(',', '')}\nPLANNER dwb mppi\nZONE north süd\n"
    words = ["sh", str(HERE / "design.sh"), "2026", str(repetitions)]
    done = subprocess.run(words, input=parameters, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout.splitlines()


def test_a_shell_script_finds_the_same_ids_seeds_and_order(tmp_path: Path) -> None:
    """And a further value and repetitions change no line that was there."""
    before, after = by_shell("0.25, 1", 2), by_shell("0.25, 1, 3.5", 3)
    assert len(before) == 16 and len(after) == 36
    assert listed(tmp_path, "0.250, 1", 2, 0) == listed(tmp_path, "1, 0.25", 2, 4711) == before
    assert listed(tmp_path, "0.25, 1, 3.5", 3, 1) == after
    assert [line for line in after if line in set(before)] == before
