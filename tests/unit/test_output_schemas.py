"""The schemas of what srprov prints: valid, closed, and every field explained. tests/lab holds real outputs to them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from msgspec.structs import replace

from srprov import data
from srprov.cli.doctor import doctor_json
from srprov.execution import Outcome
from srprov.facts.preconditions import Verdict, judge
from srprov.planning.policy import KINDS
from srprov.resource import Action, Condition
from tests.unit.facts.test_preconditions import GOOD, RIGHT, WELL, replies

OUTPUTS = (
    "assign",
    "bundle",
    "collect",
    "compare",
    "doctor",
    "export",
    "facts",
    "images",
    "import",
    "locks",
    "logs",
    "plan",
    "probe",
    "run",
    "runs",
    "snapshot",
    "status",
    "trials",
    "trials-run",
    "verify",
)


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
        judge(replace(WELL, docker=None), replies("", "", "0", "", "none"), RIGHT),
    )
    document = doctor_json({"r1": well, "r2": bad}, {"r3": "no route"})
    assert {check["verdict"] for checks in document["robots"].values() for check in checks} == {
        verdict.value for verdict in Verdict
    }
    assert list(Draft202012Validator(data.schema("doctor")).iter_errors(document)) == []
    assert list(Draft202012Validator(data.schema("doctor")).iter_errors({**document, "more": 1}))
