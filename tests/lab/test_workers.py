"""`--workers 2` on real robots: the same runs, a worker that is killed, Ctrl-C, and images from worker to worker.

Of two workers the first has robot1 and robot3, the second robot2.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.transport.workers.counting import shard
from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, wait_until
from tests.lab.test_locks import OURS, free, release, slow, until_it_builds

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
SHARDED = ("--workers", "2")


@pytest.fixture
def three(lab: Lab, tmp_path: Path) -> Iterator[tuple[Lab, str]]:
    """Give the lab, and the inventory of its first three robots; what a test leaves there is removed."""
    assert [shard(robot, 2) for robot in ROBOTS] == [0, 1, 0], "both workers have a robot"
    yield lab, part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")


def workers_of(run: subprocess.Popen[str]) -> list[int]:
    """Give the processes that a run has started for its connections, in the order of their numbers."""
    listed = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    lines = {int(pid): Path(f"/proc/{pid}/cmdline").read_bytes() for pid in listed}
    return sorted(pid for pid, line in lines.items() if b"workers.worker" in line)


def came_of(report: dict[str, Any]) -> dict[str, Any]:
    """Give what two runs have in common: not their times, nor how often a robot was asked whether it is done."""
    steps = [(step["id"], step["outcome"]) for step in report["steps"]]
    counts = {name: report[name] for name in ("changed", "unchanged", "failed", "skipped", "unreachable", "assignment")}
    return {**counts, "steps": steps, "connections": {n: r["connections"] for n, r in report["robots"].items()}}


def test_all_verbs_say_and_do_the_same_as_one_process(three: tuple[Lab, str], tmp_path: Path) -> None:
    """Plans byte by byte; reports but for their times; an image that one robot builds gets to another worker's."""
    lab, inventory = three
    path, said = slow(tmp_path, "shared", ROBOTS[:2], 0), []
    for sharing in ((), SHARDED):
        common = (path, "-i", inventory, *sharing)
        planned = lab.srprov("plan", *common)
        assert planned.code == 0, planned
        applied = lab.srprov("apply", *common, "--yes", "--settle", "0", "--json")
        assert applied.code == 0, applied
        images = {lab.inspect(robot, f"srprov.shared.s{n}")["Image"] for n, robot in enumerate(ROBOTS[:2])}
        assert len(images) == 1
        if sharing:
            inside(lab, common, tmp_path)
        gone = lab.srprov("destroy", *common, "--yes", "--json")
        assert gone.code == 0, gone
        said.append((planned.out, came_of(applied.json), came_of(gone.json)))
        for robot in ROBOTS[:2]:
            lab.shell(robot, "sh", "-c", "docker image prune -af >/dev/null; docker builder prune -af >/dev/null")
            assert lab.leftovers(robot)["containers"] == NOTHING["containers"]
    assert said[0] == said[1]


def inside(lab: Lab, common: tuple[str, ...], folder: Path) -> None:
    """Go through streams of both directions."""
    path, *rest = common
    said = lab.srprov("exec", path, "s1", *rest, "--", "sh", "-c", "cat; echo out; exit 3", stdin="in\n")
    assert (said.code, said.out) == (3, "in\nout\n"), said
    (folder / "sent").write_text("content\n" * 100_000)
    for words in ((str(folder / "sent"), "s1:/there"), ("s1:/there", str(folder / "back"))):
        copied = lab.srprov("cp", path, *words, *rest)
        assert copied.code == 0, copied
    assert (folder / "back").read_bytes() == (folder / "sent").read_bytes()


@pytest.mark.soak
def test_trials_results_and_waits_go_through_workers(three: tuple[Lab, str], tmp_path: Path) -> None:
    """A robot of one worker ends the trial; what comes home of the other's is what the container wrote."""
    lab, inventory = three
    path, home = tmp_path / "trial.edf", tmp_path / "home"
    write = "head -c 3000000 /dev/zero | tr '\\0' x >/out/data.bin; echo ready; sleep 86400"
    services = {
        "writer": busybox("sh", "-c", write, robot="robot1", stop_signal="SIGKILL"),
        "job": busybox("true", robot="robot2", job=True),
    }
    results = {"writer": [{"path": "/out/data.bin", "required": True}]}
    until = {"all": [{"completed": "job"}, {"log": {"service": "writer", "matches": "ready"}}]}
    path.write_text(edf("trial", services, results=results, trials={"until": until, "timeout": "120s"}))
    common = (str(path), "-i", inventory, *SHARDED)
    ran = lab.srprov("run", *common, "-o", str(tmp_path / "run"), "--yes")
    assert ran.code == 0, ran
    applied = lab.srprov("apply", *common, "--yes", "--settle", "0")
    assert applied.code == 0, applied
    waited = lab.srprov("wait", *common, "--until", "completed:job", "--until", "log:writer=ready")
    assert waited.code == 0, waited
    collected = lab.srprov("collect", *common, "-o", str(home))
    assert collected.code == 0, collected
    for folder in (tmp_path / "run", home):
        (data,) = folder.rglob("data.bin")
        assert data.read_bytes() == b"x" * 3_000_000
    assert lab.srprov("destroy", *common, "--yes").code == 0


def test_a_killed_worker_costs_its_own_robots_and_the_next_apply_converges(
    three: tuple[Lab, str], tmp_path: Path
) -> None:
    """SIGKILL in the middle of a build: exit 4, locks are free, nothing of it runs on, the other robot goes on."""
    lab, inventory = three
    path = tmp_path / "killed.edf"
    slow(tmp_path, "killed", ["robot1"], 300)
    sleep = {"command": ["sleep", "86400"], "stop_signal": "SIGKILL"}
    services = {"s0": {"cdf": "killed.cdf", "robot": "robot1", **sleep}, "s1": busybox(robot="robot2")}
    path.write_text(edf("killed", services), encoding="utf-8")
    common = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", *SHARDED)
    run = begin(lab, *common, "--json")
    until_it_builds(lab, ["robot1"])
    assert not free(lab, "robot1")
    found = workers_of(run)
    assert len(found) == 2
    begun = time.monotonic()
    os.kill(found[0], signal.SIGKILL)
    out, err = run.communicate(timeout=240)
    assert run.returncode == 4, (out, err)
    assert time.monotonic() - begun < 60, "nobody waits for a robot whose worker is gone"
    report = json.loads(out)
    assert "robot1" in report["unreachable"] and "robot2" not in report["unreachable"], report
    assert "SIGKILL" in err
    ends = {step["id"]: step["outcome"] for step in report["steps"]}
    assert ends["robot2/container:srprov.killed.s1"] in ("changed", "skipped"), ends
    assert not Path(f"/proc/{found[1]}").exists(), "the other one ended with the run"
    wait_until(lambda: all(free(lab, robot) for robot in ROBOTS), 10, "the locks are free")
    assert [lab.shell(robot, "sh", "-c", OURS).out for robot in ROBOTS] == ["", "", ""]
    wait_until(lambda: not lab.containers("robot1"), 20, "Docker ends a build whose client is gone")

    slow(tmp_path, "killed", ["robot1"], 0)
    path.write_text(edf("killed", services), encoding="utf-8")
    again = lab.srprov(*common, "--json")
    assert again.code == 0, again
    assert [sorted(lab.containers(robot)) for robot in ROBOTS] == [["srprov.killed.s0"], ["srprov.killed.s1"], []]
    assert lab.srprov("destroy", str(path), "-i", inventory, "--yes", *SHARDED).code == 0


@pytest.mark.soak
def test_ctrl_c_of_a_terminal_lets_a_step_of_a_worker_end(three: tuple[Lab, str], tmp_path: Path) -> None:
    """The whole group of processes gets the signal, as from a terminal; the step that runs still ends well (130)."""
    lab, inventory = three
    path = slow(tmp_path, "soft", ["robot1", "robot2"], 300)
    run = begin(lab, "apply", path, "-i", inventory, "--yes", "--settle", "0", "--json", *SHARDED)
    until_it_builds(lab, ["robot1", "robot2"])
    os.killpg(run.pid, signal.SIGINT)
    with pytest.raises(subprocess.TimeoutExpired):  # it waits for the step
        run.wait(1)
    release(lab, ["robot1", "robot2"])
    out, err = run.communicate(timeout=120)
    assert run.returncode == 130, err
    report = json.loads(out)
    assert [step["id"] for step in report["steps"] if "image:" in step["id"] and step["outcome"] == "changed"], report
    assert all(free(lab, robot) for robot in ROBOTS) and not any(lab.containers(robot) for robot in ROBOTS)


@pytest.mark.soak
def test_a_worker_ends_with_the_program_that_started_it(three: tuple[Lab, str], tmp_path: Path) -> None:
    """Killed, it says no goodbye: the workers notice, and the robots are free."""
    lab, inventory = three
    path = slow(tmp_path, "orphans", ["robot1", "robot2"], 300)
    run = begin(lab, "apply", path, "-i", inventory, "--yes", *SHARDED)
    until_it_builds(lab, ["robot1", "robot2"])
    found = workers_of(run)
    run.send_signal(signal.SIGKILL)
    run.wait(60)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in found), 10, "the workers are gone")
    wait_until(lambda: all(free(lab, robot) for robot in ROBOTS), 10, "the locks are free")
    wait_until(lambda: not any(lab.containers(robot) for robot in ROBOTS), 20, "Docker ended the build")
