"""The schemas that ship: valid, explained, and the same for a field that two of them have."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from srprov.cli.main import run
from srprov.data import schema
from srprov.definitions import check_files
from srprov.definitions.runtime import RUNTIME_FIELDS
from tests.unit.definitions.examples import BASE, CDF, EDF

KINDS = ("cdf", "edf", "inventory-vars")


def _properties(part: object, root: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(part, dict):
        for name, field in part.get("properties", {}).items():
            target = root["$defs"][field["$ref"].rsplit("/", 1)[-1]] if "$ref" in field else field
            yield f"{path}.{name}", target
        for key, value in part.items():
            yield from _properties(value, root, f"{path}.{key}" if key not in ("properties", "$defs") else path)
    if isinstance(part, list):
        for item in part:
            yield from _properties(item, root, path)


@pytest.mark.parametrize("kind", KINDS)
def test_schema_is_valid_and_every_field_is_explained(kind: str) -> None:
    Draft202012Validator.check_schema(schema(kind))
    for path, field in _properties(schema(kind), schema(kind)):
        assert field.get("description"), path
        assert field.get("examples"), path


@pytest.mark.parametrize("kind", KINDS)
def test_examples_fit_their_own_schema(kind: str) -> None:
    root = schema(kind)
    for path, field in _properties(root, root):
        for example in field["examples"]:
            errors = list(Draft202012Validator({**field, "$defs": root.get("$defs", {})}).iter_errors(example))
            assert not errors, f"{path}: {example}: {errors[0].message}"


def test_shared_fields_are_the_same_in_both() -> None:
    cdf, edf = schema("cdf"), schema("edf")
    service = edf["properties"]["services"]["additionalProperties"]["properties"]
    only_edf = {"parameter", "trials", "trial_point"}
    only_edf |= {f"{kind}_condition" for kind in ("completed", "exit", "log", "until", "success")}
    assert {name: part for name, part in edf["$defs"].items() if name not in only_edf} == cdf["$defs"]
    assert {name for name in cdf["properties"] if name in service} == RUNTIME_FIELDS | {"requires", "image", "cdf"}
    assert set(cdf["$defs"]) == RUNTIME_FIELDS | {"requires", "git"}


@pytest.mark.parametrize(("kind", "text"), [("edf", EDF), ("cdf", CDF), ("cdf", BASE)])
def test_an_editors_validator_accepts_the_full_documents(kind: str, text: str) -> None:
    document = json.loads(json.dumps(yaml.safe_load(text)))
    assert [error.message for error in Draft202012Validator(schema(kind)).iter_errors(document)] == []


def test_schema_verb_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", "edf"]) == 0
    assert json.loads(capsys.readouterr().out) == schema("edf")


def test_schema_verb_refuses_an_unknown_kind(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", "nothing"]) == 5
    assert "known: assign, bundle, cdf, collect, compare, config, doctor" in capsys.readouterr().err


def test_the_manual_names_every_field_and_its_examples_are_valid(tmp_path: Path) -> None:
    manual = (Path(__file__).parents[3] / "docs" / "definitions.md").read_text()
    for kind in KINDS:
        for name in schema(kind)["properties"]:
            assert f"`{name}`" in manual, name
    table = manual.split("### `requires`\n")[1].split("\n## ")[0]
    for name in schema("cdf")["$defs"]["requires"]["properties"]:
        assert f"\n| `{name}` | " in table, name
    blocks = [block.split("```")[0] for block in manual.split("```yaml\n")[1:]]
    (tmp_path / "talker.py").write_text("")
    (tmp_path / "talker.cdf").write_text(next(block for block in blocks if block.startswith("cdf: 1\nbase")))
    (tmp_path / "experiment.edf").write_text(next(block for block in blocks if block.startswith("edf: 1")))
    (tmp_path / "inventory.yml").write_text(next(block for block in blocks if block.startswith("all:")))
    assert check_files([tmp_path / "experiment.edf", tmp_path / "talker.cdf", tmp_path / "inventory.yml"]) == []
