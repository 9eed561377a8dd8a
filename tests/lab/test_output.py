"""What scripts rely on: one JSON document, the keys that are documented, events as they happen, --limit, exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import NOTHING, Done, Lab, busybox, edf, part_of_lab
from tests.lab.looks import begin, ids, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
RUN_KEYS = {"instance", "changed", "unchanged", "failed", "skipped", "unreachable", "assignment", "cost", "robots"}
RUN_KEYS |= {"duration_s", "phases", "run"}
ROBOT_KEYS = {"changed", "failed", "connections", "bytes_sent", "bytes_received", "duration_s"}
SERVICES = {
    "web": busybox(robot="robot1", volumes=["./parts:/parts:ro", "log:/log"], healthcheck={"test": ["CMD", "true"]}),
    "client": busybox(robot="robot2", depends_on=["web"]),
    "extra": busybox(robot="robot3", network="host"),
}


@pytest.fixture
def experiment(tmp_path: Path) -> str:
    """Write an experiment that has a bit of everything."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "file.txt").write_text("shipped", encoding="utf-8")
    path = tmp_path / "sample.edf"
    path.write_text(edf("sample", SERVICES), encoding="utf-8")
    return str(path)


def only_document(done: Done, kind: str) -> Any:
    """Give the one JSON document on standard output, after holding it to its schema."""
    document = json.loads(done.out)  # raises when anything stands before or after it
    problems = sorted(Draft202012Validator(data.schema(kind)).iter_errors(document), key=str)
    assert not problems, f"{problems[0].json_path}: {problems[0].message}"
    return document


def test_json_is_one_document_of_the_documented_shape(lab: Lab, experiment: str, tmp_path: Path) -> None:
    """`plan`, `apply`, `status`, `facts` and `destroy` print exactly what their schemas and the manual say."""
    # a robot that cannot be reached, and a step that fails, must not change the shape
    closed = {"ansible_port": 2222}
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    worse = part_of_lab(lab, [*ROBOTS, "robot4"], tmp_path / "worse.yml", robot4=closed)
    common = (experiment, "--allow", "host-network")

    planned = lab.srprov("plan", experiment, "-i", inventory, "--json")
    assert planned.code == 0, planned
    plan = only_document(planned, "plan")
    (asked,) = plan["permissions"]
    assert (asked["kind"], asked["service"]) == ("host-network", "extra") and "the robot's network (" in asked["what"]
    kinds = {step["module"] for step in plan["steps"]}
    assert kinds >= {"network", "vxlan", "file", "tree", "volume", "container"}

    applied = lab.srprov("apply", *common, "-i", inventory, "--yes", "--json", "--settle", "0")
    assert applied.code == 0, applied
    report = only_document(applied, "run")
    assert report.keys() >= RUN_KEYS and all(robot.keys() >= ROBOT_KEYS for robot in report["robots"].values())
    assert report["assignment"] == {"web": "robot1", "client": "robot2", "extra": "robot3"}
    assert report["changed"] == len(plan["steps"]) == sum(robot["changed"] for robot in report["robots"].values())
    assert [step["number"] for step in report["steps"]] == [step["number"] for step in plan["steps"]]
    assert sum(report["phases"].values()) == pytest.approx(report["duration_s"], abs=0.1)

    seen = lab.srprov("status", experiment, "-i", worse, "--json")
    assert seen.code == 4, seen
    rows = only_document(seen, "status")
    real = {one[:12] for one in ids(lab, ROBOTS, "sample").values()}
    assert {row["container"] for row in rows["services"]} == real
    assert list(rows["unreachable"]) == ["robot4"]

    path = Path(experiment)
    broken = {**SERVICES, "extra": {**SERVICES["extra"], "image": "srprov-no-such-image:1"}}
    path.write_text(edf("sample", broken), encoding="utf-8")
    planned = lab.srprov("plan", experiment, "-i", worse, "--json", "--detailed-exitcode")
    assert planned.code == 4, "a robot out of reach comes before differences"
    assert list(only_document(planned, "plan")["unreachable"]) == ["robot4"]
    failed = lab.srprov("apply", *common, "-i", worse, "--yes", "--json", "--settle", "0")
    assert failed.code == 3, failed
    report = only_document(failed, "run")
    assert report["unreachable"] == ["robot4"]
    assert (report["failed"], report["skipped"]) == (1, 1)

    known = lab.srprov("facts", "-i", worse, "--json")
    assert known.code == 4, known
    assert list(only_document(known, "facts")["robots"]) == ROBOTS

    gone = lab.srprov("destroy", experiment, "-i", inventory, "--yes", "--json", "--volumes")
    assert gone.code == 0, gone
    report = only_document(gone, "run")
    assert (report["assignment"], report["cost"]) == ({}, 0)
    assert ids(lab, ROBOTS, "sample") == {}


def test_a_plan_in_a_file_has_the_same_shape_and_its_own_parts(lab: Lab, experiment: str, tmp_path: Path) -> None:
    """`plan -o` writes what `plan --json` prints and what it takes to apply it, as the schema describes both."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    target = tmp_path / "plan.json"
    planned = lab.srprov("plan", experiment, "-i", inventory, "--json", "-o", str(target))
    assert planned.code == 0, planned
    shown = only_document(planned, "plan")
    written = only_document(Done(0, target.read_text(encoding="utf-8"), ""), "plan")
    assert {key: value for key, value in written.items() if key in shown and key != "steps"} == {
        key: value
        for key, value in shown.items()
        if key not in ("steps", "hash")  # a file's is worked out again
    }
    for less, more in zip(shown["steps"], written["steps"], strict=True):
        assert {key: more[key] for key in less if key != "commands"} == {
            key: value for key, value in less.items() if key != "commands"
        }
    assert {"fingerprints", "inputs", "blobs"} <= written.keys()


def test_events_are_written_as_they_happen(lab: Lab, experiment: str, tmp_path: Path) -> None:
    """One JSON per line; each step that is done has a start and then an end, with the outcome that the report has."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    events = tmp_path / "events.ndjson"
    words = ("--allow", "host-network", "-i", inventory, "--yes", "--json", "--settle", "4", "--events", str(events))
    services = {**SERVICES, "late": busybox(robot="robot1", depends_on={"job": {"condition": "completed"}})}
    services["job"] = busybox("sh", "-c", "exit 3", robot="robot2", job=True)
    Path(experiment).write_text(edf("sample", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    run = begin(lab, "apply", experiment, *words)

    def ends_so_far() -> int:
        return events.read_text(encoding="utf-8").count('"event": "end"') if events.exists() else 0

    wait_until(lambda: ends_so_far() >= 5, 60, "five steps have ended")
    assert run.poll() is None, "events stand in the file while the run goes on"
    out, err = run.communicate(timeout=120)
    assert run.returncode == 3, err
    report = json.loads(out)
    seen = [json.loads(line) for line in events.read_text(encoding="utf-8").splitlines()]
    assert [list(Draft202012Validator(data.schema("events")).iter_errors(one)) for one in seen] == [[]] * len(seen)
    assert [one["time"] for one in seen] == sorted(one["time"] for one in seen)
    for step in report["steps"]:
        mine = [one for one in seen if one["step"] == step["number"] and one["event"] in ("start", "end")]
        kinds = [one["event"] for one in mine]
        assert {(one["id"], one["robot"]) for one in mine} == {(step["id"], step["id"].split("/")[0])}
        assert mine[-1]["outcome"] == step["outcome"], step
        if step["outcome"] == "skipped":
            assert kinds == ["end"] and mine[0]["text"] == step["message"]
        else:
            # whoever does not stay up ends a second time
            assert kinds[:2] == ["start", "end"] and len(kinds) == (3 if step["outcome"] == "failed" else 2), step
    assert {one["event"] for one in seen} >= {"start", "end", "waiting"}
    assert {step["outcome"] for step in report["steps"]} == {"changed", "failed", "skipped"}


def test_limit_changes_the_chosen_robots_only(lab: Lab, experiment: str, tmp_path: Path) -> None:
    """The others have no trace; what is decided stays the same; a whole apply then does the rest."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    words = ("apply", experiment, "--allow", "host-network", "-i", inventory, "--yes", "--json", "--settle", "0")
    first = lab.srprov(*words, "--limit", "robot1")
    assert first.code == 0, first
    report = only_document(first, "run")
    assert report["assignment"] == {"web": "robot1", "client": "robot2", "extra": "robot3"}
    assert {step["id"].split("/")[0] for step in report["steps"]} == {"robot1"}
    assert "left out by --limit or --exclude" in first.err
    assert ids(lab, ROBOTS, "sample").keys() == {"srprov.sample.web"}
    assert [lab.leftovers(robot) for robot in ROBOTS[1:]] == [NOTHING] * 2

    second = lab.srprov(*words, "--exclude", "robot3")
    assert second.code == 0, second
    assert {step["id"].split("/")[0] for step in second.json["steps"]} == {"robot2"}
    assert lab.leftovers("robot3") == NOTHING
    third = lab.srprov(*words)
    assert third.code == 0, third
    assert {step["id"].split("/")[0] for step in third.json["steps"]} == {"robot3"}
    shown = lab.srprov("facts", "-i", inventory, "--json", "--limit", "robot[2:3]")
    assert list(shown.json["robots"]) == ["robot2", "robot3"]
    less = lab.srprov("destroy", experiment, "-i", inventory, "--yes", "--json", "--volumes", "--limit", "robot2")
    assert less.code == 0, less
    assert ids(lab, ROBOTS, "sample").keys() == {"srprov.sample.web", "srprov.sample.extra"}
    assert lab.leftovers("robot2") == NOTHING


@pytest.mark.parametrize(
    "words",
    [["--limit", "robot77"], ["--limit", "robot1:!robot1"], ["--exclude", "all"], ["--limit", "nobody", "--json"]],
    ids=" ".join,
)
def test_a_choice_of_no_robot_is_an_error(
    lab_of_module: Lab, experiment: str, tmp_path: Path, words: list[str]
) -> None:
    """Nothing is done and nothing printed on standard output; exit 5, and the message names what there is."""
    lab = lab_of_module
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    for verb in (["apply", "--yes", "--allow", "all"], ["plan"], ["destroy", "--yes"]):
        refused = lab.srprov(*verb, experiment, "-i", inventory, *words)
        assert refused.code == 5, refused
        assert refused.out == ""
        assert "robot1, robot2, robot3" in refused.err
    assert ids(lab, ROBOTS, "sample") == {}
