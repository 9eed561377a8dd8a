"""What goes wrong on real robots: the others go on, the message says what to do, and nothing is left half done."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, Done, Lab, busybox, edf, only_the_record, part_of_lab
from tests.lab.looks import begin, ids, wait_until

pytestmark = pytest.mark.lab


def lines_about(text: str, start: str) -> str:
    """Give the first line that begins so, with the indented lines that belong to it."""
    lines = text.splitlines()
    first = next((at for at, line in enumerate(lines) if line.startswith(start)), None)
    assert first is not None, f"no line begins with {start!r}:\n{text}"
    last = first + 1
    while last < len(lines) and lines[last].startswith(" "):
        last += 1
    return "\n".join(lines[first:last])


def outcomes(report: dict[str, Any]) -> dict[str, str]:
    """Give step id -> outcome of what `apply --json` printed."""
    return {step["id"]: step["outcome"] for step in report["steps"]}


def logins(lab: Lab, robot: str) -> int:
    """Count the logins that a robot's sshd has let in so far."""
    return lab.shell(robot, "cat", "/var/log/sshd.log").out.count("Accepted publickey")


# ---- robots that cannot be reached


def test_robots_that_cannot_be_reached_are_named_and_the_others_done(mended: Lab, tmp_path: Path) -> None:
    """A dead robot's services stay put and the plan says so; what is wrong on others is still made right; exit 4."""
    lab, robots = mended, ["robot1", "robot2", "robot3"]
    path = tmp_path / "three.edf"
    path.write_text(edf("three", {name: busybox() for name in "abc"}), encoding="utf-8")
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")
    assert up.code == 0, up
    home = up.json["assignment"]
    assert sorted(home.values()) == robots
    same = lab.containers(home["b"])

    lab.srprov("lab", "kill", home["c"])
    # robot4 has nothing on the port; robot5 is idle and could run what the dead robot ran
    inventory = part_of_lab(lab, [*robots, "robot4", "robot5"], tmp_path / "more.yml", robot4={"ansible_port": 2222})
    changed = {"a": busybox("sleep", "4711"), "b": busybox(), "c": busybox()}
    path.write_text(edf("three", changed), encoding="utf-8")
    common = (str(path), "-i", inventory, "--timeout", "8")

    planning = begin(lab, "plan", *common)  # both only look, and wait for the same dead robot
    seen = lab.srprov("status", *common, "--json")
    assert seen.code == 4, seen
    rows = {row["service"]: (row["robot"], row["state"]) for row in seen.json["services"]}
    assert rows["c"] == (home["c"], "unreachable")
    assert rows["a"][1].startswith("Up")
    planned, why = planning.communicate(timeout=120)
    assert planning.returncode == 4, why
    assert f"note: c stays on {home['c']}, which cannot be reached" in planned
    applied = lab.srprov("apply", *common, "--yes", "--json", "--settle", "0")
    assert applied.code == 4, applied
    report = applied.json
    assert report["unreachable"] == sorted([home["c"], "robot4"])
    assert report["assignment"] == home
    # robot5 is new here, and becomes a witness of the placement
    wanted = {f"{home['a']}/container:srprov.three.a", "robot5/file:/var/lib/srprov/three/placement.json"}
    assert {step["id"] for step in report["steps"] if step["outcome"] == "changed"} == wanted
    assert (report["failed"], report["skipped"]) == (0, 0)
    assert f"note: c stays on {home['c']}, which cannot be reached" in applied.err
    dead = lines_about(applied.err, f"unreachable: {home['c']}: ")
    assert re.search(r"no (answer|route)", dead) and "is the robot switched on" in dead
    closed = lines_about(applied.err, "unreachable: robot4: ")
    assert "port 2222: connection refused" in closed and "does sshd run on the robot, on this port?" in closed
    assert lab.inspect(home["a"], "srprov.three.a")["Config"]["Cmd"] == ["sleep", "4711"]
    assert lab.containers(home["b"]) == same
    assert lab.leftovers("robot5") == only_the_record("three")

    lab.srprov("lab", "restart", home["c"])
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    back = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--limit", "@failed")
    assert back.code == 0, back
    assert back.json["assignment"] == home
    assert {step["id"].partition("/")[0] for step in back.json["steps"]} == {home["c"]}
    assert "srprov.three.c" in lab.containers(home["c"], running=True)
    again = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--limit", "@failed")
    assert again.code == 5 and "nothing failed in the last run of three" in again.err, again


def test_a_service_does_not_start_before_one_whose_robot_is_gone(mended: Lab, tmp_path: Path) -> None:
    """Whether what it depends on has started cannot be seen, so it is skipped, and the message names the robot."""
    lab, robots = mended, ["robot1", "robot2"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "ordered.edf"
    alone = {"first": busybox(robot="robot1"), "other": busybox(robot="robot2")}
    slots = {"slots_per_robot": 2}
    path.write_text(edf("ordered", alone, placement=slots), encoding="utf-8")
    up = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0")
    assert up.code == 0, up
    lab.srprov("lab", "kill", "robot1")
    ordered = {**alone, "then": busybox(robot="robot2", depends_on=["first"])}
    path.write_text(edf("ordered", ordered, placement=slots), encoding="utf-8")
    applied = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0", "--timeout", "8")
    assert applied.code == 4, applied
    ends = {step["id"]: (step["outcome"], step["message"]) for step in applied.json["steps"]}
    outcome, why = ends["robot2/container:srprov.ordered.then"]
    assert outcome == "skipped"
    assert "robot1/container:srprov.ordered.first" in why and "robot1 is unreachable" in why
    assert "srprov.ordered.then" not in lab.containers("robot2")


def test_a_robot_that_dies_in_the_middle_is_a_result_and_not_the_end(mended: Lab, tmp_path: Path) -> None:
    """While a step waits on it a robot loses its power: what needs it is skipped, the rest is done, exit 4."""
    lab = mended
    inventory = part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "lab.yml")
    check = {"test": ["CMD", "test", "-e", "/tmp/ready"], "interval": "1s", "retries": 60}
    services = {
        "slow": busybox(robot="robot1", healthcheck=check),
        "waits": busybox(robot="robot2", depends_on={"slow": {"condition": "healthy"}}),
        "other": busybox(robot="robot3"),
    }
    path = tmp_path / "mid.edf"
    path.write_text(edf("mid", services), encoding="utf-8")
    run = begin(lab, "apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")
    wait_until(lambda: "srprov.mid.slow" in lab.containers("robot1", running=True), 30, "slow runs")
    lab.srprov("lab", "kill", "robot1")
    out, err = run.communicate(timeout=120)
    assert run.returncode == 4, err
    report = json.loads(out)
    assert report["unreachable"] == ["robot1"]
    ends = outcomes(report)
    assert ends["robot2/container:srprov.mid.waits"] == "skipped"
    assert ends["robot3/container:srprov.mid.other"] == "changed"
    assert "srprov.mid.other" in lab.containers("robot3", running=True)
    assert "srprov.mid.waits" not in lab.containers("robot2")


# ---- robots without Docker


def test_a_robot_without_docker_runs_nothing_and_matters_only_when_it_is_needed(mended: Lab, tmp_path: Path) -> None:
    """It is not eligible: exit 0 while others have room; with one service too many exit 8, with the reason."""
    lab, robots = mended, ["robot11", "robot12", "robot13"]
    spec = tmp_path / "lab-spec.yml"
    spec.write_text("robots:\n  robot13: {docker: false}\n", encoding="utf-8")
    up = lab.srprov("lab", "up", "-n", "13", "--spec", str(spec))
    assert up.code == 0, up
    assert lab.shell("robot13", "docker", "version", check=False).code != 0
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "fits.edf"
    path.write_text(edf("fits", {name: busybox() for name in "ab"}), encoding="utf-8")

    fits = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")
    assert fits.code == 0, fits
    assert sorted(fits.json["assignment"].values()) == ["robot11", "robot12"]
    before = lab.everywhere(robots[:2])
    assert {name for there in before.values() for name in there} == {"srprov.fits.a", "srprov.fits.b"}

    needed = [
        ({name: busybox() for name in "abc"}, "make Docker work on robot13"),
        ({"a": busybox(robot="robot13"), "b": busybox()}, "remove 'robot: robot13' from service 'a'"),
    ]
    for services, remedy in needed:
        path.write_text(edf("fits", services), encoding="utf-8")
        refused = lab.srprov("apply", str(path), "-i", inventory, "--yes")
        assert refused.code == 8, refused
        assert re.search(r"cannot run on robot13: no Docker \(.+\)", refused.err), refused
        assert remedy in refused.err
    assert lab.everywhere(robots[:2]) == before
    traces = "find /var/lib/srprov -mindepth 1 2>/dev/null; ls /sys/class/net | grep ^srp; true"
    assert lab.shell("robot13", "sh", "-c", traces).out == ""


# ---- host keys


def host_key_prints(lab: Lab, robots: list[str]) -> dict[str, str]:
    """Give robot -> fingerprint of its host key, read on its own console."""
    command = ("ssh-keygen", "-lf", "/etc/ssh/ssh_host_ed25519_key.pub")
    return {robot: lab.shell(robot, *command).out.split()[1] for robot in robots}


def test_a_changed_host_key_stops_everything_on_that_robot(lab_of_module: Lab, tmp_path: Path) -> None:
    """The message has both fingerprints and remedies that work as they stand; until then nobody logs in there."""
    lab, robots = lab_of_module, ["robot6", "robot7"]
    prints = host_key_prints(lab, robots)
    whole = lab.site.known_hosts.read_text(encoding="utf-8").splitlines()
    keys = {line.split()[0]: line for line in whole}
    here = {robot: str(lab.site.address(robot)) for robot in robots}
    known = tmp_path / "known_hosts"
    false = keys[here["robot6"]].replace(here["robot6"], here["robot7"])
    known.write_text(f"{keys[here['robot6']]}\n{false}\n", encoding="utf-8")
    options = {"ansible_ssh_common_args": f"-o UserKnownHostsFile={known}"}
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml", robot6=options, robot7=options)
    path = tmp_path / "keys.edf"
    path.write_text(edf("keys", {"a": busybox()}), encoding="utf-8")
    before = logins(lab, "robot7")

    def apply() -> Done:
        return lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")

    changed = apply()
    assert changed.code == 4, changed
    assert changed.json["unreachable"] == ["robot7"]
    assert changed.json["assignment"] == {"a": "robot6"}
    assert "srprov.keys.a" in lab.containers("robot6", running=True)
    said = lines_about(changed.err, "unreachable: robot7: its host key changed")
    assert f"ssh-ed25519 {prints['robot7']}" in said
    assert f"{known}:2 has ssh-ed25519 {prints['robot6']}" in said
    remedy = f"ssh-keygen -f {known} -R {here['robot7']}"
    assert said.endswith(remedy)

    subprocess.run(["sh", "-c", remedy], check=True, capture_output=True, timeout=100)
    unknown = apply()
    assert unknown.code == 4, unknown
    said = lines_about(unknown.err, "unreachable: robot7: its host key is unknown")
    assert f"ssh-ed25519 {prints['robot7']}" in said
    remedy = f"ssh-keyscan -t ed25519 {here['robot7']} >> {known}"
    assert said.endswith(remedy)
    assert logins(lab, "robot7") == before, "nobody logs in on a robot that is not known"
    assert known.read_text(encoding="utf-8").count("\n") == 1, "a key is never put on record by itself"

    subprocess.run(["sh", "-c", remedy], check=True, capture_output=True, timeout=100)
    fine = apply()
    assert fine.code == 0, fine
    assert logins(lab, "robot7") == before + 1


# ---- what no placement can do


TAG = {"eye": busybox(requires={"tags": ["lidar"]}), "brain": busybox()}
CROWD = {name: busybox() for name in ("one", "two", "three", "four")}


@pytest.mark.parametrize(
    ("services", "code", "said"),
    [
        pytest.param(
            TAG,
            8,
            [
                "no robot can run 'eye'",
                *(f"eye cannot run on {robot}: needs tag 'lidar'" for robot in ("robot8", "robot9", "robot10")),
                "srprov_tags in the inventory",
            ],
            id="a tag that nobody has",
        ),
        pytest.param(
            CROWD,
            8,
            [
                "'four', 'one', 'three' and 'two' can run only on robot10 (1 slot), robot8 (1 slot) and robot9 (1 slot)"
                ": 4 places needed, 3 there",
                "srprov_slots in the inventory",
            ],
            id="more services than slots",
        ),
        pytest.param(
            {"a": busybox(robot="robot88"), "b": busybox()},
            5,
            ["services.a.robot", "'robot88', which is not in the inventory", "did you mean 'robot8'?", "none.edf:"],
            id="a pin on a robot that is not in the inventory",
        ),
    ],
)
def test_what_cannot_be_placed_is_explained_and_nothing_is_touched(
    lab_of_module: Lab, tmp_path: Path, services: dict[str, Any], code: int, said: list[str]
) -> None:
    """`plan` and `apply` name each robot's reason and what would help; no robot has a trace of it afterwards."""
    lab, robots = lab_of_module, ["robot8", "robot9", "robot10"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = tmp_path / "none.edf"
    path.write_text(edf("none", services), encoding="utf-8")
    for verb in (("plan",), ("apply", "--yes")):
        refused = lab.srprov(*verb, str(path), "-i", inventory)
        assert refused.code == code, refused
        assert refused.out == ""
        for words in said:
            assert words in refused.err, refused
    assert [lab.leftovers(robot) for robot in robots] == [NOTHING] * 3


# ---- steps that fail


def test_a_step_that_fails_stops_what_needs_it_and_nothing_else(lab_of_module: Lab, tmp_path: Path) -> None:
    """An image that does not exist: exit 3, the dependents are skipped and name the step, all others are done."""
    lab = lab_of_module
    inventory = part_of_lab(lab, ["robot8", "robot9", "robot10"], tmp_path / "lab.yml")
    services = {
        "broken": {"image": "srprov-no-such-image:1", "robot": "robot8"},
        "after": busybox(robot="robot9", depends_on=["broken"]),
        "later": busybox(robot="robot9", depends_on=["after"]),
        "apart": busybox(robot="robot10"),
    }
    path = tmp_path / "fails.edf"
    path.write_text(edf("fails", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    failed = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "0")
    assert failed.code == 3, failed
    steps = {step["id"]: step for step in failed.json["steps"]}
    image = steps.pop("robot8/image:srprov-no-such-image:1")
    assert image["outcome"] == "failed"
    assert "srprov-no-such-image" in image["message"]
    chain = ["robot8/container:srprov.fails.broken", "robot9/container:srprov.fails.after"]
    chain.append("robot9/container:srprov.fails.later")
    needed = image
    for identity in chain:
        step = steps.pop(identity)
        assert step["outcome"] == "skipped"
        assert f"needs #{needed['number']} ({needed['id']})" in step["message"]
        assert f"skipped: #{step['number']} {identity}: {step['message']}" in failed.err
        needed = step
    assert {step["outcome"] for step in steps.values()} == {"changed"}
    report = failed.json
    assert (report["failed"], report["skipped"], report["changed"]) == (1, 3, len(steps))
    assert set(ids(lab, ["robot8", "robot9", "robot10"], "fails")) == {"srprov.fails.apart"}
    assert "srprov.fails.apart" in lab.containers("robot10", running=True)


def test_a_service_that_dies_in_its_first_breath_is_a_failure(lab_of_module: Lab, tmp_path: Path) -> None:
    """Docker says `started` of it; the run says 3, its exit code, and its last lines."""
    lab = lab_of_module
    inventory = part_of_lab(lab, ["robot9", "robot10"], tmp_path / "lab.yml")
    services = {"dies": busybox("sh", "-c", "echo no config; sleep 0.5; exit 23"), "lives": busybox()}
    path = tmp_path / "dies.edf"
    path.write_text(edf("dies", services), encoding="utf-8")
    failed = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--json")
    assert failed.code == 3, failed
    (step,) = (step for step in failed.json["steps"] if step["outcome"] != "changed")
    assert step["id"].endswith("/container:srprov.dies.dies")
    assert "did not stay up: exited with code 23" in step["message"] and "no config" in step["message"]
    assert failed.json["failed"] == 1


# ---- Ctrl-C


@pytest.fixture
def waiting(lab_of_module: Lab, tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Give EDF and inventory of an experiment of which one part waits until another is healthy."""
    check = {"test": ["CMD", "test", "-e", "/tmp/ready"], "interval": "1s", "retries": 90}
    services = {
        "slow": busybox(robot="robot4", healthcheck=check),
        "waits": busybox(robot="robot5", depends_on={"slow": {"condition": "healthy"}}),
    }
    path = tmp_path / "waiting.edf"
    path.write_text(edf("waiting", services), encoding="utf-8")
    inventory = part_of_lab(lab_of_module, ["robot4", "robot5"], tmp_path / "lab.yml")
    yield str(path), inventory
    gone = lab_of_module.srprov("destroy", str(path), "-i", inventory, "--yes")
    assert gone.code == 0, gone


def interrupt_when(run: subprocess.Popen[str], words: str, seconds: float) -> str:
    """Send SIGINT as soon as these words stand on stderr; give all of stderr up to there."""
    assert run.stderr is not None
    said = ""
    deadline = threading.Timer(6 * seconds, run.kill)
    deadline.start()
    try:
        while words not in said:
            line = run.stderr.readline()
            assert line, f"it ended with {run.wait()}, or was ended after {seconds} s, before {words!r}:\n{said}"
            said += line
    finally:
        deadline.cancel()
    run.send_signal(signal.SIGINT)
    return said


def test_ctrl_c_while_it_waits_says_what_was_not_reached(lab_of_module: Lab, waiting: tuple[str, str]) -> None:
    """Exit 130 at once, with a report; the next apply goes on from there and then all is as it should be."""
    lab, (path, inventory), robots = lab_of_module, waiting, ["robot4", "robot5"]
    common = ("apply", path, "-i", inventory, "--yes", "--settle", "0")
    run = begin(lab, *common, "--json")
    interrupt_when(run, "to be healthy", 60)
    begun = time.monotonic()
    out, err = run.communicate(timeout=120)
    assert time.monotonic() - begun < 30
    assert run.returncode == 130, err
    report = json.loads(out)
    ends = outcomes(report)
    assert ends["robot4/container:srprov.waiting.slow"] == "changed"
    assert ends["robot5/container:srprov.waiting.waits"] == "not reached"
    assert (report["not_reached"], report["failed"], report["skipped"]) == (1, 0, 0)
    assert "not reached: #" in err and "robot5/container:srprov.waiting.waits" in err
    assert "interrupted in" in err.splitlines()[-1]
    before = ids(lab, robots, "waiting")
    assert set(before) == {"srprov.waiting.slow"}

    lab.shell("robot4", "docker", "exec", "srprov.waiting.slow", "touch", "/tmp/ready")
    again = lab.srprov(*common, "--json")
    assert again.code == 0, again
    assert outcomes(again.json) == {"robot5/container:srprov.waiting.waits": "changed"}
    assert ids(lab, robots, "waiting").items() > before.items()
    assert "srprov.waiting.waits" in lab.containers("robot5", running=True)
    third = lab.srprov(*common, "--json")
    assert (third.code, third.json["changed"]) == (0, 0)


def test_ctrl_c_during_the_last_look_keeps_the_report(lab_of_module: Lab, tmp_path: Path) -> None:
    """All is done and only the wait whether services stay up is left: 130, and what was done is reported as done."""
    lab = lab_of_module
    path = tmp_path / "last.edf"
    path.write_text(edf("last", {"a": busybox()}), encoding="utf-8")
    inventory = part_of_lab(lab, ["robot4"], tmp_path / "lab.yml")
    run = begin(lab, "apply", str(path), "-i", inventory, "--yes", "--json", "--settle", "60")
    interrupt_when(run, "checking that services stay up", 60)
    out, err = run.communicate(timeout=120)
    assert run.returncode == 130, err
    report = json.loads(out)
    assert set(outcomes(report).values()) == {"changed"}
    assert outcomes(report)["robot4/container:srprov.last.a"] == "changed"
    assert "srprov.last.a" in lab.containers("robot4", running=True)


def test_ctrl_c_while_robots_are_asked_changes_nothing(mended: Lab, tmp_path: Path) -> None:
    """It does not wait for a robot that does not answer: 130 within moments, and no robot has a trace."""
    lab = mended
    lab.srprov("lab", "kill", "robot10")
    path = tmp_path / "early.edf"
    path.write_text(edf("early", {"a": busybox()}), encoding="utf-8")
    inventory = part_of_lab(lab, ["robot11", "robot10"], tmp_path / "lab.yml")
    run = begin(lab, "apply", str(path), "-i", inventory, "--yes", "--timeout", "40")
    interrupt_when(run, "asking 2 robots", 20)
    begun = time.monotonic()
    _, err = run.communicate(timeout=120)
    assert run.returncode == 130, err
    assert time.monotonic() - begun < 30, err
    assert "Traceback" not in err and "interrupted" in err
    assert "srprov.early.a" not in lab.containers("robot11")


def test_a_second_ctrl_c_does_not_wait_for_a_long_step(lab_of_module: Lab, tmp_path: Path) -> None:
    """The first lets a running build go on, the second leaves at once, and neither ends in a traceback."""
    lab = lab_of_module
    (tmp_path / "long.cdf").write_text("cdf: 1\nname: long\nbase: busybox\nrun: [sleep 120]\n", encoding="utf-8")
    path = tmp_path / "long.edf"
    path.write_text(edf("long", {"a": {"cdf": "long.cdf", "command": ["sleep", "9"]}}), encoding="utf-8")
    inventory = part_of_lab(lab, ["robot4"], tmp_path / "lab.yml")
    run = begin(lab, "apply", str(path), "-i", inventory, "--yes")
    interrupt_when(run, "Step 1/", 60)
    with pytest.raises(subprocess.TimeoutExpired):  # it waits for the running step
        run.wait(2)
    run.send_signal(signal.SIGINT)
    begun = time.monotonic()
    _, err = run.communicate(timeout=120)
    assert time.monotonic() - begun < 30, err
    assert run.returncode == 130, err
    assert "Traceback" not in err
    assert "srprov.long.a" not in lab.containers("robot4")
