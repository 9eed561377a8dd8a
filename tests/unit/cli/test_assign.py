"""`srprov assign` without a robot: from stored facts, as text, JSON and pictures."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest

from srprov import data
from srprov.cli.inputs import load_inventory
from srprov.cli.main import run
from srprov.cli.stored_facts import stored_facts
from srprov.facts.document import facts_document
from srprov.facts.model import Docker, HostFacts, Link
from srprov.facts.stored import read_document
from tests.unit.assignment.worlds import robot

EDF = """\
edf: 1
name: demo
services:
  cam: {image: busybox, cost: 30, per_robot: {tags: [camera]}}
  nav: {image: busybox, cost: 50}
  map: {image: busybox, cost: 40}
  work: {image: busybox, cost: 20, replicas: 2, depends_on: [cam, nav]}
pools: [{name: brain, services: [nav, map], discount: 0.8}]
relations: {different_robot: [[work, nav]]}
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an EDF, an inventory and facts of three robots."""
    (tmp_path / "e.edf").write_text(EDF)
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}}}\n")
    facts = {
        name: robot(name, load1=load, tags=tags)
        for name, load, tags in (("r1", 1.0, ("camera",)), ("r2", 2.0, ()), ("r3", 3.0, ("camera",)))
    }
    (tmp_path / "facts.json").write_text(json.dumps(facts_document(facts, {})))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def assign(*more: str) -> int:
    return run(["assign", "e.edf", "-i", "inv.yml", "--facts", "facts.json", *more])


def test_stored_facts_are_the_facts() -> None:
    """What `facts --json` wrote reads back to the same values."""
    one = robot(
        "r1",
        links=(Link(name="eth0", addresses=("10.0.0.1/24",), speed_mbit=100.0),),
        docker=Docker(version="27", api_version="1.46"),
        routes=("10.0.0.0/24",),
    )
    facts = {"r1": one, "r2": HostFacts(name="r2", docker_problem="none")}
    document = json.loads(json.dumps(facts_document(facts, {"r3": "no route"})))
    found = read_document(document)
    assert dict(found.facts) == facts
    assert dict(found.unreachable) == {"r3": "no route"}


def test_who_runs_what(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pool, replicas and one per robot, on one line each."""
    assert assign() == 0
    text = capsys.readouterr().out
    for line in ("cam-r3 -> r3", "map    -> r1", "nav    -> r1", "pool brain: together", "the least possible"):
        assert line in text


def test_json_holds_to_its_schema(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the keys that scripts rely on, and the front only when asked for."""
    keys = ["assignment", "cost", "optimal", "matrix", "why_not", "pools", "jain"]
    assert assign("--json") == 0
    plain = json.loads(capsys.readouterr().out)
    assert list(plain) == keys
    assert assign("--json", "--pareto") == 0
    front = json.loads(capsys.readouterr().out)
    assert list(front) == [*keys, "pareto"]
    for document in (plain, front):
        jsonschema.validate(document, data.schema("assign"))
    assert plain["matrix"]["cam-r1"]["r2"] is None
    assert plain["why_not"]["cam-r1"]["r2"] == "pinned to r1"
    assert plain["pools"] == {"brain": "together"}


def test_explain_says_why_and_why_not(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cost by term, the next best robot, the reason for every exclusion, and the front."""
    assert assign("--explain", "--pareto") == 0
    text = capsys.readouterr().out
    assert "cam-r1 not on r2: pinned to r1" in text
    assert "next r2 +" in text
    assert "FAIRNESS" in text


def test_what_cannot_be_is_told_with_8(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The conflict and what would help, on standard error; as JSON on standard output, too."""
    (lab / "e.edf").write_text(EDF.replace("replicas: 2", "replicas: 4"))
    assert assign() == 8
    assert capsys.readouterr().out == ""
    assert assign("--json") == 8
    said = capsys.readouterr()
    refused = json.loads(said.out)
    jsonschema.validate(refused, data.schema("assign"))
    assert list(refused) == ["assignment", "code", "error", "why_not", "hint"]
    assert refused["assignment"] is None
    assert "4 places needed, 3 there" in refused["error"]
    assert "give r1, r2 or r3 one more slot" in refused["hint"]
    assert "4 places needed, 3 there" in said.err
    assert "give r1, r2 or r3 one more slot" in said.err


def test_robots_without_stored_facts_are_out_of_reach(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And the exit code says so."""
    (lab / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}, r4: {}}}\n")
    assert assign() == 4
    assert "unreachable: r4: not in the stored facts" in capsys.readouterr().err


def test_history_changes_who_is_next(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With fairness, who carried much before is spared; a record of the wrong shape is named."""
    (lab / "e.edf").write_text("edf: 1\nname: d\nservices: {a: {image: x}}\nplacement: {fairness: 0.9}\n")
    (lab / "runs" / "1").mkdir(parents=True)
    record = lab / "runs" / "1" / "assignment.json"
    record.write_text(json.dumps({"assignment": {"a": "r1"}, "costs": {"a": 50.0}}))
    assert assign("--json") == 0
    assert json.loads(capsys.readouterr().out)["assignment"] == {"a": "r1"}
    assert assign("--json", "--history", "runs") == 0
    assert json.loads(capsys.readouterr().out)["assignment"] == {"a": "r2"}
    record.write_text("{}")
    assert assign("--history", "runs") == 5
    assert "runs/1/assignment.json is not a run record" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text", ["", "[]", '{"robots": []}', '{"robots": {"r1": 3}}', '{"robots": {"r1": {"cpus": "four"}}}',
             '{"robots": {"r1": {"links": [3]}}}', '{"robots": {"r1": {"tags": "a"}}}'],
)  # fmt: skip
def test_facts_of_the_wrong_shape_are_refused(lab: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    """With 5, and a word on where such a file comes from."""
    (lab / "facts.json").write_text(text)
    assert assign() == 5
    assert "srprov facts --json" in capsys.readouterr().err


def test_pictures(lab: Path) -> None:
    """SVG is text with the names in it, the same each time; PNG is a PNG."""
    pytest.importorskip("matplotlib")
    assert assign("--svg", "a.svg", "--png", "a.png", "--pareto") == 0
    assert assign("--svg", "b.svg", "--pareto") == 0
    assert (lab / "a.svg").read_bytes() == (lab / "b.svg").read_bytes()
    assert (lab / "a.png").read_bytes().startswith(b"\x89PNG")


def test_a_projects_settings_for_pictures_run_nothing(lab: Path) -> None:
    """matplotlib reads `matplotlibrc` of the current folder, which can have it start LaTeX with words of its own."""
    pytest.importorskip("matplotlib")
    (lab / "matplotlibrc").write_text("text.usetex: True\nfigure.facecolor: red\n")
    (lab / "bin").mkdir()
    for program in ("latex", "kpsewhich", "dvipng"):
        (lab / "bin" / program).write_text(f"#!/bin/sh\ntouch {lab}/ran\n")
        (lab / "bin" / program).chmod(0o755)
    words = ["-m", "srprov", "assign", "e.edf", "-i", "inv.yml", "--facts", "facts.json", "--svg", "a.svg"]
    env = {**os.environ, "PATH": f"{lab}/bin:{os.environ['PATH']}", "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, *words], env=env, capture_output=True, text=True, timeout=60, check=False)
    assert not (lab / "ran").exists()
    assert done.returncode == 0, done
    assert "#ff0000" not in (lab / "a.svg").read_text()


def test_a_picture_is_not_written_by_way_of_a_link(lab: Path) -> None:
    """With a project that was cloned come links of a stranger's."""
    pytest.importorskip("matplotlib")
    own = lab / "own"
    own.write_text("mine")
    for name in ("a.svg", "a.png"):
        (lab / name).symlink_to(own)
    assert assign("--svg", "a.svg", "--png", "a.png") == 0
    assert own.read_text() == "mine"
    assert (lab / "a.svg").read_text().startswith("<?xml") and not (lab / "a.png").is_symlink()


def test_pictures_read_nothing_of_the_folder_where_they_are_made(lab: Path) -> None:
    """A link would have a line of its file in a warning, and a pipe would be waited for."""
    pytest.importorskip("matplotlib")
    os.mkfifo(lab / "matplotlibrc")
    words = ["-m", "srprov", "assign", "e.edf", "-i", "inv.yml", "--facts", "facts.json", "--svg", "a.svg"]
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, *words], env=env, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (lab / "a.svg").exists()


def test_without_matplotlib_the_extra_is_named(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Everything else works without it."""
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert assign("--svg", "a.svg") == 5
    assert "pip install 'matplotlib>=3.8'" in capsys.readouterr().err


def test_without_services_there_is_no_picture(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Words instead of what matplotlib says about an empty matrix."""
    (lab / "e.edf").write_text("edf: 1\nname: d\nservices: {a: {image: x, per_robot: {tags: [lidar]}}}\n")
    assert assign("--svg", "a.svg") == 5
    assert "nothing is placed, so there is no picture" in capsys.readouterr().err


def test_the_inventory_counts_on_top_of_stored_facts(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Tags and devices are added, and its bandwidth wins, as with robots that are asked."""
    (lab / "e.edf").write_text(
        "edf: 1\nname: d\nservices: {a: {image: x, requires: {tags: [lidar], devices: [/dev/lidar]}}}\n"
    )
    assert assign() == 8
    assert "the tag 'lidar' (srprov_tags in the inventory)" in capsys.readouterr().err
    own = "{srprov_tags: [lidar], srprov_devices: [/dev/lidar], srprov_bandwidth_mbit: 10}"
    (lab / "inv.yml").write_text(f"all: {{hosts: {{r1: {{}}, r2: {own}, r3: {{}}}}}}\n")
    assert assign("--json") == 0
    assert json.loads(capsys.readouterr().out)["assignment"] == {"a": "r2"}
    found, _ = stored_facts(lab / "facts.json", load_inventory(("inv.yml",)))
    assert found.facts["r2"].speed_mbit == 10.0
    assert found.facts["r3"].tags == ("camera",)


ABSURD = {
    "400 digits": '{"robots": {"r1": {"load1": 1' + "0" * 400 + "}}}",
    "5000 digits": '{"robots": {"r1": {"memory_total": 1' + "0" * 5000 + "}}}",
    "beyond floats": '{"robots": {"r1": {"load1": 1e999}}}',
    "deep": '{"robots": {"r1": ' + "[" * 100_000,
    "deep enough to parse": '{"robots": {"r1": {"tags": ' + "[" * 800 + "]" * 800 + "}}}",
}


@pytest.mark.parametrize("text", ABSURD.values(), ids=ABSURD)
def test_absurd_files_are_refused(lab: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    """Facts and earlier runs, with 5 and without a traceback."""
    (lab / "facts.json").write_text(text)
    assert assign() == 5
    (lab / "runs" / "1").mkdir(parents=True)
    (lab / "runs" / "1" / "assignment.json").write_text(text)
    assert assign("--history", "runs") == 5
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("field", "value"),
    [("load1", "-1"), ("cpus", "0"), ("slots", "0"), ("underlay_mtu", "-1"), ("memory_available", "9"),
     ("swap_free", "1"), ("docker", '{"version": "1", "api_version": "x"}')],
)  # fmt: skip
def test_facts_out_of_range_are_refused(lab: Path, capsys: pytest.CaptureFixture[str], field: str, value: str) -> None:
    """Naming the robot and the field."""
    (lab / "facts.json").write_text(f'{{"robots": {{"r1": {{"memory_total": 8, "{field}": {value}}}}}}}')
    assert assign() == 5
    said = capsys.readouterr().err
    assert "'r1'" in said
    assert field in said


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_what_is_no_number_is_refused(lab: Path, capsys: pytest.CaptureFixture[str], word: str) -> None:
    """JSON has no such words, though Python reads them."""
    (lab / "facts.json").write_text(f'{{"robots": {{"r1": {{"load1": {word}}}}}}}')
    assert assign() == 5
    assert f"the number {word} is too large or not a number" in capsys.readouterr().err


def test_per_robot_that_matches_none_is_told(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On standard output, but beside JSON on standard error."""
    (lab / "e.edf").write_text("edf: 1\nname: d\nservices: {a: {image: x, per_robot: {tags: [lidar, arm]}}}\n")
    note = "no robot has the tags 'lidar', 'arm', so 'a' runs nowhere"
    assert assign() == 0
    assert note in capsys.readouterr().out
    assert assign("--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["assignment"] == {}
    assert note in said.err


@pytest.mark.parametrize("cdf", ["../private.cdf", "own.cdf"])
def test_a_file_elsewhere_needs_a_permission(lab: Path, capsys: pytest.CaptureFixture[str], cdf: str) -> None:
    """What it requires of a robot is told: a stranger's EDF may name any, also by a CDF of its own that extends it."""
    here = lab / "project"
    here.mkdir()
    (lab / "private.cdf").write_text("cdf: 1\nname: p\nimage: x\nrequires: {tags: [not-for-strangers]}\n")
    (here / "own.cdf").write_text("cdf: 1\nname: own\nextends: ../private.cdf\n")
    (here / "e.edf").write_text(f"edf: 1\nname: d\nservices: {{a: {{cdf: {cdf}}}}}\n")
    asked = ["assign", str(here / "e.edf"), "-i", "inv.yml", "--facts", "facts.json"]
    assert run(asked) == 9
    said = capsys.readouterr()
    assert "not-for-strangers" not in said.out + said.err
    assert "--allow outside" in said.err
    assert run([*asked, "--allow", "outside"]) == 8
    assert "not-for-strangers" in capsys.readouterr().err


def test_the_time_limit_is_per_search(capsys: pytest.CaptureFixture[str]) -> None:
    """And the help says so."""
    assert run(["assign", "--help"]) == 0
    assert "Stop each search after so long" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("link", ["runs", "runs/x", "runs/x/assignment.json"])
def test_no_link_of_a_project_says_what_earlier_runs_were(
    lab: Path, capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory, link: str
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "x"
    elsewhere.mkdir()
    (elsewhere / "assignment.json").write_text("one word of somebody else's")
    leads_to = {"runs": elsewhere.parent, "runs/x": elsewhere}.get(link, elsewhere / "assignment.json")
    (lab / link).parent.mkdir(parents=True, exist_ok=True)
    (lab / link).symlink_to(leads_to)
    assert assign("--history", "runs") == 5
    assert f"{link} is a link that leads out of its folder" in capsys.readouterr().err
