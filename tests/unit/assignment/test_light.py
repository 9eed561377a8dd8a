"""A small decision imports neither numpy nor OR-Tools: each takes longer to import than such a decision to make."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]

PLAN = """
from tests.fakes import World
from tests.worlds import experiment, plan_for, service
world = World().add("r1", "r2", "r3")
assert set(plan_for(world, experiment(service("a"), service("b"))).assignment) == {"a", "b"}
"""
ANSWER = """
from tests.unit.assignment.worlds import assign, experiment, found, robot, service
what = experiment(*(service(name) for name in "abcd"), service("e", tags=("x",)), same_robot=(("a", "b"),))
robots = [robot(name, tags=("x",) if name == "r2" else (), load1=float(name[1])) for name in ("r1", "r2", "r3", "r4")]
answer = assign(what, found(*robots, unreachable={"away": "no route"}), {"c": "away", "d": "r4"})
for part in (answer.matrix, answer.why_not, answer.runner_up):
    assert {name: part[name] for name in part}
assert answer.jain and answer.least and not answer.optimal
"""
LARGE = """
from tests.unit.assignment.worlds import assign, experiment, found, robot, service
names = [f"s{i}" for i in range(40)]
assign(experiment(*map(service, names)), found(*map(robot, names)))
"""
LOADED = "import sys\nprint(*sorted({'numpy', 'ortools'} & sys.modules.keys()))"


@pytest.mark.parametrize(
    ("code", "loaded"),
    [
        ("import srprov.controller.plan", ""),
        ("import srprov.controller.plan, srprov.controller.run, srprov.record, srprov.cli.main", ""),
        (ANSWER, ""),
        (PLAN, ""),
        (LARGE, "numpy ortools"),
    ],
)
def test_what_is_small_is_decided_without_them(code: str, loaded: str) -> None:
    """From the facts to the plan; what is large needs them, or this test would see nothing."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{LOADED}"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == loaded
