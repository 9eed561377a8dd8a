"""What `status` and `plan` say of what does not run as it should, or runs twice; and that stops and runs end."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, edf, part_of_lab
from tests.lab.looks import address_of, begin, log_of, reached, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2", "robot3")


def experiment(lab: Lab, folder: Path, name: str, **services: dict[str, object]) -> tuple[str, str, str]:
    """Write an experiment for three robots; give its EDF and the inventory as arguments."""
    path = folder / f"{name}.edf"
    path.write_text(edf(name, services), encoding="utf-8")
    return str(path), "-i", part_of_lab(lab, ROBOTS, folder / "lab.yml")


def test_status_names_what_is_missing_or_wrong(lab_of_module: Lab, tmp_path: Path) -> None:
    """A container, a link as after a reboot, a service never placed; an apply mends them, and scripts see it."""
    lab = lab_of_module
    pinned = {name: busybox(robot=robot) for name, robot in zip("abc", ROBOTS, strict=True)}
    words = experiment(lab, tmp_path, "whole", a=pinned["a"], b=pinned["b"])
    try:
        assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
        well = lab.srprov("status", *words, "--exit-code")
        assert (well.code, "PROBLEM" in well.out) == (0, False), well
        given = address_of(lab, "robot1", "srprov.whole.a")
        lab.shell("robot1", "docker", "rm", "--force", "srprov.whole.a")
        (link,) = lab.shell("robot2", "sh", "-c", "cd /sys/class/net; echo srpv*").out.split()
        lab.shell("robot2", "ip", "link", "del", link)
        experiment(lab, tmp_path, "whole", **pinned)

        seen = lab.srprov("status", *words, "--exit-code", "--json")
        assert seen.code == 2, seen
        rows = {row["service"]: (row["robot"], row["state"], row["problem"]) for row in seen.json["services"]}
        assert rows["a"] == ("robot1", "missing", "missing")
        assert rows["b"][0] == "robot2" and rows["b"][1].startswith("Up") and rows["b"][2] == ""
        assert rows["c"] == ("", "missing", "missing")
        assert {row["service"]: row["given_address"] for row in seen.json["services"]}["a"] == given
        lacks = [(one["robot"], one["kind"], one["name"], one["problem"]) for one in seen.json["links"]]
        assert lacks == [("robot2", "vxlan", link, "missing")]
        text = lab.srprov("status", "--instance", "whole", *words[1:])
        assert text.code == 0 and f"robot2: VXLAN link {link} of whole is not there" in text.out, text

        assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
        mended = lab.srprov("status", *words, "--exit-code", "--json")
        assert (mended.code, mended.json["links"]) == (0, []), mended
        other = address_of(lab, "robot2", "srprov.whole.b")
        assert reached(lab, "robot1", "srprov.whole.a", [other]) == {other}
    finally:
        assert lab.srprov("destroy", *words, "--yes").code == 0


def test_a_stop_without_end_ends_with_the_limit_of_the_run(lab_of_module: Lab, tmp_path: Path) -> None:
    """A service that ignores SIGTERM and asks for a day is named and killed; the lock is held no longer than that."""
    lab = lab_of_module
    deaf = busybox(robot="robot1", stop_signal="SIGTERM", stop_grace_period="24h")
    words = experiment(lab, tmp_path, "deaf", a=deaf)
    assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
    begun = time.monotonic()
    gone = lab.srprov("destroy", *words, "--yes", "--stop-timeout", "1")
    assert gone.code == 0, gone
    assert time.monotonic() - begun < 120
    assert "a on robot1 asks for 86400 s to stop and is killed after 1 s; --stop-timeout gives it longer" in gone.err
    assert lab.leftovers("robot1") == NOTHING


@pytest.mark.soak
def test_one_sigterm_ends_a_run_that_waits_for_a_stop(lab_of_module: Lab, tmp_path: Path) -> None:
    """Ten seconds later it reports and is gone, and with it every lock; the next destroy finishes."""
    lab = lab_of_module
    deaf = busybox(robot="robot1", stop_signal="SIGTERM", stop_grace_period="24h")
    words = experiment(lab, tmp_path, "deaf", a=deaf, b=busybox(robot="robot2"))
    assert lab.srprov("apply", *words, "--yes", "--settle", "0").code == 0
    events = tmp_path / "events.jsonl"
    run = begin(lab, "destroy", *words, "--yes", "--json", "--stop-timeout", "3600", "--events", str(events))
    wait_until(lambda: events.exists() and "container:srprov.deaf.a" in events.read_text(), 60, "the stop begins")
    run.send_signal(signal.SIGTERM)
    begun = time.monotonic()
    out, err = run.communicate(timeout=120)
    assert time.monotonic() - begun < 120, err
    assert run.returncode == 130, err
    ends = {step["id"]: (step["outcome"], step["message"]) for step in json.loads(out)["steps"]}
    assert ends["robot1/container:srprov.deaf.a"] == (
        "not reached", "interrupted: it did not end within 10 s, and was cut off",
    )  # fmt: skip
    assert ends["robot2/container:srprov.deaf.b"][0] == "changed"
    assert "Traceback" not in err
    locks = lab.srprov("locks", *words[1:], "--json")
    assert locks.json["robots"] == dict.fromkeys(ROBOTS), locks
    gone = lab.srprov("destroy", *words, "--yes", "--stop-timeout", "1")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING] * len(ROBOTS)


@pytest.mark.soak
def test_a_copy_on_a_robot_that_comes_back_is_told_apart_and_removed(lab_of_module: Lab, tmp_path: Path) -> None:
    """A robot that was only cut off still runs what was placed elsewhere meanwhile: all verbs say which is which."""
    lab = lab_of_module
    words = experiment(lab, tmp_path, "twin", a=busybox("sh", "-c", "echo here; sleep 86400"))
    try:
        first = lab.srprov("apply", *words, "--yes", "--json", "--settle", "0")
        assert first.code == 0, first
        old = first.json["assignment"]["a"]
        address = address_of(lab, old, "srprov.twin.a")
        assert lab.srprov("lab", "partition", old).code == 0
        try:
            common = ("--unreachable", "reassign", "--timeout", "12")
            planned = lab.srprov("plan", *words, *common)
            assert f"a may still run on {old}, which cannot be reached" in planned.out, planned
            moved = lab.srprov("apply", *words, *common, "--yes", "--json", "--settle", "0")
            assert moved.code == 0, moved
            new = moved.json["assignment"]["a"]
        finally:
            assert lab.srprov("lab", "heal", old).code == 0
        assert {address_of(lab, robot, "srprov.twin.a") for robot in (old, new)} == {address}
        assert log_of(lab, old, "srprov.twin.a") == ["here"]

        seen = lab.srprov("status", *words, "--json", "--exit-code")
        assert seen.code == 2, seen
        assert {row["robot"]: row["problem"] for row in seen.json["services"]} == {old: "duplicate", new: ""}
        assert f"duplicate of the one on {new}" in lab.srprov("status", *words).out
        again = lab.srprov("plan", *words)
        assert "with one address" in again.out and f"names {new}" in again.out, again
        healed = lab.srprov("apply", *words, "--yes", "--json", "--settle", "0")
        assert healed.code == 0 and healed.json["assignment"] == {"a": new}, healed
        assert [robot for robot in ROBOTS if "srprov.twin.a" in lab.containers(robot)] == [new]
        assert lab.srprov("status", *words, "--exit-code").code == 0
    finally:
        assert lab.srprov("destroy", *words, "--yes").code == 0
