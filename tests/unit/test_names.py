"""One rule for each kind of name, held wherever a name enters; no pattern lets a last line feed pass."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov import names
from srprov.cli.main import run
from srprov.definitions import load_experiment, load_inventory
from srprov.definitions.expand import expand
from srprov.definitions.model import Service
from srprov.errors import DefinitionError, UsageError
from srprov.facts.placements import read_placements
from srprov.modules.observe import observe_queries, parse_observed
from srprov.network.record import read_record
from srprov.planning import planfile, planread
from srprov.planning.plan import Plan
from srprov.wire import Reply
from tests.unit.planning.test_policy import experiment

ROOT = Path(__file__).parents[2]
_OUTSIDE = ("../../../etc", "a/b", "..", ".", "ä/")
_OF_COMMANDS = ("-x", "--prune", "a b", "$(id)", "-a\0")
HOSTILE = (*_OUTSIDE, *_OF_COMMANDS, "", "a\n", "a\x1b[2J", "a" * 201, "é" * 101)


@pytest.mark.parametrize("kind", ["instance", "service", "robot"])
@pytest.mark.parametrize("name", HOSTILE)
def test_no_kind_of_name_leaves_its_folder_or_its_line(kind: str, name: str) -> None:
    assert not names.valid(kind, name)
    with pytest.raises(UsageError):
        names.checked(kind, name)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("instance", "hello-2"),
        ("service", "cam_front-1"),
        ("robot", "turtle01.lab"),
        ("robot", "fe80::1%eth0"),
        ("robot", "192.0.2.1"),
    ],
)
def test_ordinary_names_pass(kind: str, name: str) -> None:
    assert names.checked(kind, name) == name


@pytest.mark.parametrize("name", ["../../../etc", "/etc", "a\n", "A", "a b", "a/../b"])
@pytest.mark.parametrize("verb", [["plan"], ["apply", "--yes"], ["destroy", "--yes"], ["status"], ["logs"], ["assign"]])
def test_an_instance_from_the_command_line_is_held_to_the_rule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: list[str], name: str
) -> None:
    """It became a folder of the controller and of robots as it was; the environment is held to it too."""
    (tmp_path / "e.edf").write_text("edf: 1\nname: demo\nservices: {a: {image: busybox}}\n")
    words = [*verb, str(tmp_path / "e.edf"), "-i", "nobody,"]
    assert run([*words, "--instance", name]) == 5
    assert "cannot be the name of an instance" in capsys.readouterr().err
    monkeypatch.setenv(f"SRPROV_{verb[0].upper()}_INSTANCE", name)
    assert run(words) == 5
    assert "cannot be the name of an instance" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        'edf: 1\nname: "demo\\n"\nservices: {a: {image: busybox}}\n',
        'edf: 1\nname: demo\nservices: {"a\\n": {image: busybox}}\n',
        "edf: 1\nname: demo\nservices: {google.com: {image: busybox}}\n",
        "edf: 1\nname: demo\nservices: {localhost: {image: busybox}}\n",
        "edf: 1\nname: demo\nservices: {ip6-loopback: {image: busybox}}\n",
        'edf: 1\nname: demo\nservices: {a: {image: busybox, secrets: ["t\\n"]}}\nsecrets: {"t\\n": {env: T}}\n',
        'edf: 1\nname: demo\nservices: {a: {image: busybox, cap_add: ["NET_ADMIN\\n"]}}\n',
        'edf: 1\nname: demo\nservices: {a: {image: busybox, devices: ["/dev/x:/dev/x:rwm\\n"]}}\n',
    ],
)
def test_a_name_or_form_in_an_edf_is_whole(tmp_path: Path, text: str) -> None:
    """Neither a line feed at its end nor the name of a host elsewhere passes."""
    (tmp_path / "e.edf").write_text(text)
    with pytest.raises(DefinitionError):
        load_experiment(tmp_path / "e.edf", {})


def test_instances_of_a_service_on_each_robot_have_no_dot_either() -> None:
    """A robot's name may have dots; in a hosts file `cam-robot1.example.com` would be somebody's."""
    made = expand(experiment(Service(name="cam", image="x", per_robot=())), {"robot1.example.com": ()})
    assert list(made.services) == ["cam-robot1-example-com"]


@pytest.mark.parametrize("name", ["a/b", "../x", "-oProxyCommand=x", "a\x1bb", "'a'"])
def test_a_robots_name_in_an_inventory_is_held_to_the_rule(tmp_path: Path, name: str) -> None:
    (tmp_path / "inv.yml").write_text(json.dumps({"all": {"hosts": {name: None}}}))
    with pytest.raises(DefinitionError, match="1 problem"):
        load_inventory([tmp_path / "inv.yml"])


def test_a_plan_file_names_its_instance_by_the_rule() -> None:
    """The record of its run would be a folder anywhere."""
    whole = planfile.dump(planfile.PlanFile(plan=Plan(instance="../../x", source="", steps=()), fingerprints={}))
    with pytest.raises(UsageError, match="cannot be the name of an instance"):
        planread.load(whole, "plan.json")


@pytest.mark.parametrize("name", ["../../etc", "a\n", "x" * 99])
def test_what_a_robot_says_of_an_instance_that_cannot_be_counts_for_nothing(name: str) -> None:
    """Labels of containers, volumes and networks, and placement records."""
    body = json.dumps([{"Id": "1", "Names": ["/x"], "Labels": {"srprov.instance": name}, "State": "running"}])
    volumes = json.dumps({"Volumes": [{"Name": "v", "Labels": {"srprov.instance": name}}]})
    asked = [getattr(query, "path", "") for query in observe_queries()]
    replies = [Reply(status=200, out=volumes if "volumes" in path else body) for path in asked]
    assert {one.instance for one in parse_observed(replies)} <= {""}
    record = json.dumps({"instance": name, "serial": 3})
    assert read_placements([record]) == {}
    known = read_record({"services": {"a": {"robot": name.replace("x", "/")}}})
    assert known is not None and not known.robots
    there = {"robot": "r1", "ip": "10.128.0.9", "mac": "02:00:00:00:00:01"}
    known = read_record({"services": {one: there for one in (name, "a/json", "a b\r\n", "ok")}})
    assert known is not None and known.robots.keys() == known.addresses.keys() == {"ok"} - {name}


def patterns() -> Iterator[tuple[str, str]]:
    """Yield each pattern of our schemas, with the schema."""

    def inside(value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            for key, one in value.items():
                if key == "pattern" and isinstance(one, str):
                    yield one
                if key == "patternProperties":
                    yield from one
                yield from inside(one)
        for one in value if isinstance(value, list) else ():
            yield from inside(one)

    for file in sorted((ROOT / "schemas").glob("*.json")):
        for pattern in inside(json.loads(file.read_text(encoding="utf-8"))):
            yield file.name, pattern


def test_in_a_schema_the_end_stands_only_at_the_end() -> None:
    """Then `definitions.schema.pattern` reads it as ECMAScript does, which is what schemas are written in."""
    found = list(patterns())
    assert len(found) > 40
    assert [one for one in found if "$" in one[1][:-1].replace("\\$", "")] == []


def test_no_regular_expression_ends_in_a_dollar() -> None:
    """In Python's it also fits before a last line feed, but for the ends of lines."""
    wrong = []
    for file in sorted((ROOT / "srprov").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
                continue
            if getattr(node.func.value, "id", "") != "re" or "MULTILINE" in ast.unparse(node):
                continue
            text = node.args[0].value if isinstance(node.args[0], ast.Constant) else ""
            if isinstance(text, str) and text.endswith("$") and not text.endswith("\\$"):
                wrong.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert wrong == []
