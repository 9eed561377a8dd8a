"""The schemas of what srprov prints: valid, closed, and every field explained. tests/lab holds real outputs to them."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import pytest
from jsonschema import Draft202012Validator
from msgspec.structs import replace

from srprov import data
from srprov.cli.doctor import doctor_json
from srprov.cli.main import cli
from srprov.execution import Outcome
from srprov.facts.preconditions import Verdict, judge
from srprov.planning.policy import KINDS
from srprov.resource import Action, Condition
from tests.unit.facts.test_preconditions import GOOD, RIGHT, WELL, replies

PRINTED: Mapping[str, tuple[str, ...]] = {
    "apply": ("run", "events"),
    "assign": ("assign",),
    "build": ("run", "events"),
    "bundle": ("bundle",),
    "collect": ("collect",),
    "compare": ("compare",),
    "config": ("config",),
    "destroy": ("run", "events"),
    "diff": ("plan",),
    "doctor": ("doctor",),
    "explain": ("explain",),
    "export compose": ("export",),
    "export kubernetes": ("export",),
    "export swarm": ("export",),
    "facts": ("facts",),
    "images": ("images",),
    "import compose": ("import",),
    "import swarmrob": ("import",),
    "lab list": ("lab-list",),
    "lab status": ("lab-status",),
    "locks": ("locks",),
    "logs": ("logs",),
    "plan": ("plan",),
    "probe": ("probe",),
    "replay": ("compare", "events"),
    "report": ("report",),
    "restart": ("run", "events"),
    "run": ("trials-run", "events"),
    "runs": ("runs", "trials-run"),
    "snapshot": ("snapshot",),
    "start": ("run", "events"),
    "status": ("status",),
    "stop": ("run", "events"),
    "trials": ("trials",),
    "validate": ("validate",),
    "verify": ("verify",),
}
"""Verb -> the schemas of what it prints as JSON, and of what it writes with --events."""

OUTPUTS = (*sorted({kind for kinds in PRINTED.values() for kind in kinds}), "journal")


def verbs(command: click.Command, name: str = "") -> Iterator[tuple[str, click.Command]]:
    """Return every command that is no group of others, by its words."""
    if not isinstance(command, click.Group):
        yield name, command
        return
    context = click.Context(command, help_option_names=["-h", "--help"])
    for word in command.list_commands(context):
        inner = command.get_command(context, word)
        assert inner is not None
        yield from verbs(inner, f"{name} {word}".strip())


def writes_json(option: click.Parameter) -> bool:
    """Tell whether an option makes a verb print or write JSON."""
    choices = option.type.choices if isinstance(option.type, click.Choice) else ()
    return "--json" in option.opts or "--events" in option.opts or "json" in choices


def test_every_verb_that_prints_json_or_writes_events_has_a_schema_that_names_it() -> None:
    options = {name: [one for one in verb.params if writes_json(one)] for name, verb in verbs(cli)}
    assert sorted(PRINTED) == sorted(name for name, found in options.items() if found)
    for name, kinds in PRINTED.items():
        assert ("events" in kinds) is any("--events" in one.opts for one in options[name]), name
        for kind in kinds:
            assert name.rpartition(" ")[2] in data.schema(kind)["description"], f"{kind} does not name {name}"


def parts(schema: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Return every part of a schema that stands for a value, with its path."""
    for name, field in schema.get("properties", {}).items():
        yield f"{path}.{name}", field
        yield from parts(field, f"{path}.{name}")
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield f"{path}.{key}", schema[key]
            yield from parts(schema[key], f"{path}.{key}")
    for name, part in schema.get("$defs", {}).items():
        yield f"{path}#{name}", part
        yield from parts(part, f"{path}#{name}")


@pytest.mark.parametrize("kind", OUTPUTS)
def test_every_field_is_explained_and_nothing_else_is_allowed(kind: str) -> None:
    schema = data.schema(kind)
    Draft202012Validator.check_schema(schema)
    assert schema["additionalProperties"] is False
    for path, part in parts(schema):
        assert "$ref" in part or part["description"].endswith("."), path
        if "properties" in part:
            assert part["additionalProperties"] is False, path


@pytest.mark.parametrize("kind", OUTPUTS)
def test_examples_are_examples(kind: str) -> None:
    schema = data.schema(kind)
    for path, part in parts(schema):
        for example in part.get("examples", ()):
            problems = list(Draft202012Validator({**part, "$defs": schema.get("$defs", {})}).iter_errors(example))
            assert not problems, f"{path}: {example}"


def test_closed_lists_are_the_programs_own() -> None:
    run, plan = data.schema("run"), data.schema("plan")
    assert run["$defs"]["step"]["properties"]["outcome"]["enum"] == [outcome.value for outcome in Outcome]
    step = plan["$defs"]["step"]["properties"]
    assert step["action"]["enum"] == [action.name.lower() for action in Action]
    assert plan["$defs"]["need"]["properties"]["condition"]["enum"] == [one.value for one in Condition]
    assert list(plan["properties"]["counts"]["properties"]) == step["action"]["enum"]
    verdicts = data.schema("doctor")["$defs"]["check"]["properties"]["verdict"]["enum"]
    assert verdicts == [verdict.value for verdict in Verdict]
    assert plan["$defs"]["permission"]["properties"]["kind"]["examples"][0] in KINDS


def test_doctor_prints_what_its_schema_says() -> None:
    """With all verdicts, and with a robot that cannot be reached."""
    well, bad = (
        judge(WELL, replies(*GOOD), RIGHT),
        judge(replace(WELL, docker=None), replies("", "", "0", "", "none", "", ""), RIGHT),
    )
    document = doctor_json({"r1": well, "r2": bad}, {"r3": "no route"})
    assert {check["verdict"] for checks in document["robots"].values() for check in checks} == {
        verdict.value for verdict in Verdict
    }
    assert list(Draft202012Validator(data.schema("doctor")).iter_errors(document)) == []
    assert list(Draft202012Validator(data.schema("doctor")).iter_errors({**document, "more": 1}))


def test_the_manual_lists_every_verb_with_its_schemas() -> None:
    manual = (Path(__file__).parents[2] / "docs/json.md").read_text(encoding="utf-8")
    stated: dict[str, set[str]] = {}
    for kind, verbs_of in re.findall(r"^\| `([a-z-]+)` \| (`.*) \|", manual, re.MULTILINE):
        for verb in re.findall(r"`([a-z][a-z ]*)`", re.split("[:;]", verbs_of)[0]):
            stated.setdefault(verb, set()).add(kind)
    assert stated == {verb: set(kinds) for verb, kinds in PRINTED.items()}


def test_the_journal_of_a_published_run_is_what_its_schema_says() -> None:
    """Its rows are those of `trials-run`; what only another event has, and what none has, is refused."""
    schema = data.schema("journal")
    assert schema["$defs"] == data.schema("trials-run")["$defs"]
    validator = Draft202012Validator(schema)
    with zipfile.ZipFile(Path(__file__).parents[2] / "docs/evidence/race.zip") as bundle:
        lines = [json.loads(line) for line in bundle.read("journal.jsonl").splitlines()]
    assert [list(validator.iter_errors(line)) for line in lines] == [[]] * len(lines)
    for line in lines[:10]:
        assert not validator.is_valid({**line, "more": 1}), line["event"]
        assert not validator.is_valid({**line, "changes": []}), line["event"]
    assert not validator.is_valid({key: value for key, value in lines[1].items() if key != "trial"})
