"""Trials on real robots: each made anew, in order, with its data brought home; killed runs are gone on with."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import signal
import subprocess
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import NOTHING, Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ("robot1", "robot2")
RACER = """
echo "start $SPEED $SRPROV_SEED $SRPROV_TRIAL"
[ ! -e /out/before ] && touch /out/before || echo "NOT FRESH"
sleep "$SPEED"
echo "GOAL $SPEED"
echo "{\\"time\\": $SPEED}" >/out/result.json
exit "$CODE"
"""
REFEREE = "trap 'echo stopped; exit 0' INT; n=0; while :; do echo tick; sleep 0.1; done"
SETTINGS = {
    "repetitions": 2,
    "seed": 7,
    "until": {"any": [{"completed": "racer"}]},
    "timeout": "20s",
    "stop": {"signal": "SIGINT", "grace": "5s"},
    "success": {"all": [{"exit": {"service": "racer", "code": 0}}]},
}


def race(**settings: Any) -> str:
    """Return an EDF with two services on two robots and four points."""
    return edf(
        "race",
        {
            "racer": busybox("sh", "-c", RACER, robot="robot1"),
            "referee": busybox("sh", "-c", REFEREE, robot="robot2"),
        },
        parameters={"SPEED": {"values": [0.2, 0.4], "apply_to": "racer"}, "CODE": [0, 3]},
        trials={**SETTINGS, **settings},
        results={"racer": ["/out/result.json", "/out"]},
        metrics={
            "time": {"service": "racer", "json": "/out/result.json#/time", "unit": "s"},
            "goal": {"service": "racer", "log": "^GOAL ([0-9.]+)"},
            "ticks": {"service": "referee", "log": "^tick", "reduce": "count"},
        },
    )


class Race:
    """The experiment in a folder of its own."""

    def __init__(self, lab: Lab, folder: Path, text: str) -> None:
        self.lab, self.folder, self.home = lab, folder, folder / "run"
        self.file = folder / "race.edf"
        self.file.write_text(text)
        self.inventory = part_of_lab(lab, ROBOTS, folder / "inventory.yml")

    @property
    def words(self) -> tuple[str, ...]:
        return ("run", str(self.file), "-i", self.inventory, "-o", str(self.home), "--yes")

    def run(self, *more: str) -> Done:
        return self.lab.srprov(*self.words, *more)

    def rows(self) -> list[dict[str, str]]:
        with (self.home / "trials.csv").open(newline="") as stream:
            return list(csv.DictReader(stream))

    def events(self) -> list[dict[str, Any]]:
        journal = self.home / "journal.jsonl"
        lines = journal.read_text().split("\n")[:-1] if journal.exists() else []
        return [json.loads(line) for line in lines]

    def disturb(self, when: Callable[[list[dict[str, Any]]], bool]) -> None:
        """Begin the run, kill its controller as soon as the journal is as wanted."""
        running = begin(self.lab, *self.words)
        wait_until(lambda: when(self.events()) or running.poll() is not None, 120, "the moment to kill it")
        assert running.poll() is None, running.communicate()
        os.kill(running.pid, signal.SIGKILL)
        running.wait()

    def left(self) -> set[str]:
        """Return the containers and volumes that are on the robots."""
        words = ("sh", "-c", "docker ps -aq; docker volume ls -q")
        return {line for robot in ROBOTS for line in self.lab.shell(robot, *words).out.split()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


FINAL = ("trial", "point", "repetition", "order", "status", "verdict", "reason", "seed", "p_SPEED", "p_CODE", "m_goal",
         "m_time", "restarts", "files", "bytes")  # fmt: skip


def final(rows: list[dict[str, str]]) -> list[tuple[str, ...]]:
    """Return what must be the same however often a run was disturbed."""
    return sorted(tuple(row[name] for name in FINAL) for row in rows if row["status"] != "interrupted")


def check_tables(home: Path, rows: list[dict[str, str]]) -> None:
    """Compare the long tables with the wide one, and clocks, which are all this machine's, with the truth."""
    with (home / "metrics.csv").open(newline="") as stream:
        metrics = {(one["trial"], one["metric"]): one for one in csv.DictReader(stream)}
    for row in rows:
        for name in ("time", "goal", "ticks"):
            one = metrics.pop((row["trial"], name))
            assert one["value"] == row[f"m_{name}"] and one["service"] == ("referee" if name == "ticks" else "racer")
            assert (home / "trials" / row["trial"] / one["source"].partition("#")[0]).is_file()
    assert metrics == {}
    with (home / "clocks.csv").open(newline="") as stream:
        clocks = list(csv.DictReader(stream))
    wanted = [(row["trial"], when, robot) for row in rows for when in ("before", "after") for robot in ROBOTS]
    assert [(one["trial"], one["when"], one["robot"]) for one in clocks] == wanted
    for one in clocks:
        assert abs(float(one["offset_ms"])) <= float(one["error_ms"]) <= float(one["rtt_ms"]) / 2 + 1e-5


def check_bundle(one: Race) -> None:
    """Bundle the run: plain tools and `verify` find nothing wrong, and no file says where the robots are."""
    assert [list(Draft202012Validator(data.schema("journal")).iter_errors(line)) for line in one.events()] == [
        [] for _ in one.events()
    ]
    file, folder = one.folder / "run.zip", one.folder / "unpacked"
    made = one.lab.srprov("bundle", str(one.home), "-o", str(file))
    assert made.code == 0, made
    checked = one.lab.srprov("verify", str(file), "--json")
    assert (checked.code, [item for item in checked.json["findings"] if item["result"] == "fail"]) == (0, []), checked
    with zipfile.ZipFile(file) as archive:
        archive.extractall(folder)
    subprocess.run(["sha256sum", "-c", "--strict", "--quiet", "manifest-sha256.txt"], cwd=folder, check=True)
    hosts = json.loads((one.home / "sessions/1/inputs/inventory.yml").read_text())["all"]["hosts"]
    addresses = [host["ansible_host"].encode() for host in hosts.values()]
    assert len(addresses) == len(ROBOTS)
    for path in (path for path in folder.rglob("*") if path.is_file()):
        assert [word for word in addresses if word in path.read_bytes()] == [], path


def test_every_trial_is_run_in_its_order_and_its_data_come_home(lab: Lab, folder: Path) -> None:
    one = Race(lab, folder, race(repetitions=1))
    done = one.run()
    assert done.code == 0, done
    rows = one.rows()
    assert [row["order"] for row in rows] == [str(number) for number in range(1, 5)]
    assert {(row["p_SPEED"], row["p_CODE"], row["repetition"]) for row in rows} == {
        (speed, code, "1") for speed in ("0.2", "0.4") for code in ("0", "3")
    }
    for row in rows:
        assert (row["status"], row["verdict"]) == ("ok", "success" if row["p_CODE"] == "0" else "failure")
        assert row["m_time"] == row["m_goal"] == str(float(row["p_SPEED"]))
        assert float(row["m_ticks"]) >= 1
        assert float(row["duration_s"]) < 30
        kept = folder / "run" / "trials" / row["trial"]
        log = (kept / "logs" / "robot1.racer.log").read_text()
        assert f"start {row['p_SPEED']} {row['seed']} {row['trial']}\n" in log
        assert "NOT FRESH" not in log, "each trial begins with an empty folder"
        assert (kept / "logs" / "robot2.referee.log").read_text().endswith("stopped\n"), "it was stopped by SIGINT"
        result = kept / "results" / "racer" / "out" / "result.json"
        assert json.loads(result.read_text()) == {"time": float(row["p_SPEED"])}
        listed = json.loads((kept / "collected.json").read_text())["results"]["racer/out"]
        digests = {item["path"]: item["sha256"] for item in listed}
        assert digests["result.json"] == hashlib.sha256(result.read_bytes()).hexdigest()
    assert one.left() == set(), "containers of trials, and their results, are removed"
    assert done.err.splitlines()[-1].startswith(f"pandas.read_csv('{one.home}/trials.csv'")
    check_tables(one.home, rows)
    check_bundle(one)
    assert one.run().code == 5, "a folder that holds a run is not begun again"
    again = one.run("--resume", "--json", "-q")
    assert again.code == 0 and one.rows() == rows, again
    assert list(Draft202012Validator(data.schema("trials-run")).iter_errors(again.json)) == []
    assert len(again.json["rows"]) == again.json["done"] == 4
    assert again.err.splitlines()[0] == "4 of 4 trials count: 2 ok, failure; 2 ok, success", again
    over = lab.srprov("status", str(one.file), "-i", one.inventory, "--exit-code")
    assert over.code == 0 and "race has trials, and none is under way" in over.err, over
    gone = lab.srprov("destroy", str(one.file), "-i", one.inventory, "--yes")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING, NOTHING]


def test_a_killed_run_is_gone_on_with(lab: Lab, folder: Path) -> None:
    """SIGKILL in the middle of the second trial, and in the middle of a line: what has ended is not run again."""
    one = Race(lab, folder, race(repetitions=1, exclude=[{"SPEED": 0.4}]))

    def second_is_started(events: list[dict[str, Any]]) -> bool:
        return sum(event["event"] == "started" for event in events) == 2

    one.disturb(second_is_started)
    ended = [event["trial"] for event in one.events() if event["event"] == "end"]
    assert len(ended) == 1
    with (one.home / "journal.jsonl").open("a") as journal:
        journal.write('{"seq": 99, "ev')
    again = one.run("--resume")
    assert again.code == 0, again
    rows = one.rows()
    assert len(final(rows)) == 2
    assert [row["attempt"] for row in rows if row["trial"] == ended[0]] == ["1"]
    (lost,) = (row for row in rows if row["status"] == "interrupted")
    assert [row["attempt"] for row in rows if row["trial"] == lost["trial"]] == ["1", "2"]
    assert one.left() == set()
    numbers = [event["seq"] for event in one.events()]
    assert numbers == list(range(1, len(numbers) + 1))
    check_bundle(one)


def test_what_is_no_longer_the_same_experiment_is_not_gone_on_with(lab: Lab, folder: Path) -> None:
    """Nor where somebody gave an image's tag to another image; who accepts that begins another segment."""
    few = {"exclude": [{"SPEED": 0.4}, {"CODE": 3}]}
    for robot in ROBOTS:
        lab.shell(robot, "sh", "-c", "docker pull -q busybox && docker tag busybox race:1")
    one = Race(lab, folder, "")

    def write(repetitions: int, **settings: Any) -> str:
        text = race(repetitions=repetitions, **few, **settings).replace('"image": "busybox"', '"image": "race:1"')
        one.file.write_text("# a comment changes nothing\n" + text)
        return text

    write(1)
    done = one.run()
    assert done.code == 0, done
    write(2)
    more = one.run("--resume")
    assert more.code == 0, more
    assert len(one.rows()) == 2, "further repetitions are added"
    one.file.write_text(write(2, timeout="30s").replace("echo tick", "echo tock"))
    refused = one.run("--resume")
    assert refused.code == 9, refused
    assert "  referee: command: " in refused.err and "  trials: timeout_s: 20.0 -> 30.0" in refused.err
    assert refused.err.count(" -> ") == 2, refused.err
    write(3)
    script = "c=$(docker create race:1); docker commit -c 'LABEL moved=1' $c race:1; docker rm $c >/dev/null"
    was = lab.shell("robot1", "docker", "image", "inspect", "-f", "{{.Id}}", "race:1").out.strip()
    now = lab.shell("robot1", "sh", "-c", script).out.strip()
    moved = one.run("--resume")
    assert moved.code == 9 and f"  racer: image id: {was} -> {now}\n" in moved.err, moved
    assert moved.err.count(" -> ") == 1, moved.err
    accepted = one.run("--resume", "--accept-changes")
    assert accepted.code == 0 and [row["segment"] for row in one.rows()] == ["1", "1", "2"], accepted
    check_bundle(one)
    for robot in ROBOTS:
        lab.shell(robot, "docker", "image", "rm", "--force", "race:1")


def test_what_the_robots_did_is_data_and_what_the_equipment_did_is_not(lab: Lab, folder: Path) -> None:
    """A crash and a timeout count and are not tried again; a robot whose engine is gone does not count."""
    text = edf(
        "fates",
        {
            "racer": busybox("sh", "-c", 'case $FATE in crash) exit 4 ;; ok) exit 0 ;; *) sleep 60 ;; esac'),
            "referee": busybox(),
            "camera": busybox(),
        },
        parameters={"FATE": ["ok", "crash", "hang"]},
        trials={
            **SETTINGS, "repetitions": 1, "order": "listed", "timeout": "2s", "stop": {"signal": "SIGKILL"},
            "keep": ["camera"], "until": {"any": [
                {"log": {"service": "referee", "matches": "never"}}, {"exit": {"service": "racer", "code": 0}},
            ]},
        },
    )  # fmt: skip
    one = Race(lab, folder, text)
    one.inventory = part_of_lab(lab, ROBOTS, folder / "slots.yml", robot1={"srprov_slots": 2})
    done = one.run()
    assert done.code == 0, done
    fates = {row["p_FATE"]: (row["status"], row["verdict"], row["attempt"]) for row in one.rows()}
    camera = {robot: names for robot in ROBOTS if (names := lab.containers(robot))}
    ((where, names),) = camera.items()
    assert set(names) == {"srprov.fates.camera"}, "what is kept goes on, and the trials' own are gone"
    assert lab.inspect(where, "srprov.fates.camera")["State"]["StartedAt"] < min(
        row["started_utc"] for row in one.rows()
    )
    assert "FATE" not in str(lab.inspect(where, "srprov.fates.camera")["Config"]["Env"])
    assert fates == {
        "ok": ("ok", "success", "1"),
        "crash": ("crashed", "failure", "1"),
        "hang": ("timeout", "failure", "1"),
    }
    check_bundle(one)


@pytest.mark.soak
def test_a_robot_that_is_out_of_reach_for_a_while_spoils_no_trial(lab: Lab, folder: Path) -> None:
    """Its containers run on meanwhile; the connection and the lock are made anew, and the data are whole."""
    few = {"exclude": [{"CODE": 3}], "repetitions": 1, "timeout": "90s"}
    one = Race(lab, folder, race(**few).replace("0.2", "25").replace("0.4", "30"))
    running = begin(lab, *one.words, "--heartbeat", "1,4,6")
    wait_until(lambda: any(event["event"] == "ready" for event in one.events()), 120, "the first trial")
    for robot in ROBOTS:
        assert lab.srprov("lab", "partition", robot).code == 0
    time.sleep(12)
    for robot in ROBOTS:
        assert lab.srprov("lab", "heal", robot).code == 0
    _, said = running.communicate(timeout=200)
    assert running.returncode == 0, said
    first, second = one.rows()
    assert (first["status"], first["verdict"], first["attempt"]) == ("ok", "success", "1")
    assert float(first["controller_gap_s"]) > 5 and float(second["controller_gap_s"]) == 0
    assert first["m_time"] == str(float(first["p_SPEED"]))
    assert float(first["duration_s"]) == pytest.approx(float(first["p_SPEED"]), abs=2)


@pytest.mark.soak
def test_a_robot_that_restarts_in_a_trial_spoils_it_and_ends_the_run(lab: Lab, folder: Path) -> None:
    """What ran on it is dead, and its link is gone: the trial does not count, and going on mends the network first."""
    few = {"exclude": [{"CODE": 3}], "repetitions": 1, "timeout": "90s"}
    one = Race(lab, folder, race(**few).replace("0.2", "20").replace("0.4", "21"))
    running = begin(lab, *one.words, "--heartbeat", "1,4,6")
    wait_until(lambda: any(event["event"] == "ready" for event in one.events()), 120, "the first trial")
    assert lab.srprov("lab", "kill", "robot2").code == 0
    assert lab.srprov("lab", "restart", "robot2").code == 0
    _, said = running.communicate(timeout=200)
    assert running.returncode == 3, said
    (row,) = one.rows()
    assert row["status"] == "infrastructure" and "robot2" in row["reason"], row
    again = one.run("--resume")
    assert again.code == 0, again
    assert [row["status"] for row in one.rows()] == ["infrastructure", "ok", "ok"]


@pytest.mark.soak
def test_an_engine_that_blinks_is_waited_for_and_what_died_with_it_is_run_again(lab: Lab, folder: Path) -> None:
    """It dies in the first trial, is restarted in good order in the second, and is away when that is made anew."""
    few = {"exclude": [{"CODE": 3}], "repetitions": 1, "timeout": "90s", "order": "listed"}
    one = Race(lab, folder, race(**few).replace("0.2", "8").replace("0.4", "9"))
    running = begin(lab, *one.words)

    def await_event(name: str, count: int) -> None:
        wait_until(lambda: [event["event"] for event in one.events()].count(name) == count, 120, f"{name} {count}")

    await_event("ready", 1)
    assert lab.srprov("lab", "kill", "robot1", "--docker").code == 0
    await_event("ready", 3)
    assert lab.srprov("lab", "stop-docker", "robot2").code == 0
    assert lab.srprov("lab", "restart", "robot2", "--docker").code == 0
    # before the attempt ends: the next one begins, and has its containers, in a tenth of a second
    assert lab.srprov("lab", "kill", "robot1", "--docker").code == 0
    _, said = running.communicate(timeout=200)
    assert running.returncode == 0, said
    ends = [(row["status"], row["attempt"], row["reason"]) for row in one.rows()]
    died = "the Docker Engine of {} was away and {} did not survive it"
    first, second = died.format("robot1", "racer"), died.format("robot2", "referee")
    if ends[2][2].startswith((first, second)):  # whichever is noticed first; the other one cannot be cleared then
        ends[2] = (*ends[2][:2], second)
    assert ends == [
        ("infrastructure", "1", first), ("ok", "2", "racer completed"),
        ("infrastructure", "1", second), ("ok", "2", "racer completed"),
    ], said  # fmt: skip
    assert "waiting for robot1, up to 120 s: " in said and "robot1 is back after " in said
    assert "2 of 2 trials count: 2 ok, success\ntried again: " in said
    assert one.left() == set()
