"""The tables of classes: no field of the schemas is without a line, and no line is without a field."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from srprov import data
from srprov.exporting import classes, kubernetes_classes, swarm_classes
from srprov.exporting.classes import Table, rule_of
from srprov.exporting.model import KINDS

TOOLS = {"compose": classes, "kubernetes": kubernetes_classes, "swarm": swarm_classes}
KINDS_OF_FILE = [(tool, kind) for tool in TOOLS for kind in ("edf", "cdf")]


def fields(schema: Mapping[str, Any], part: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Return the path of every field of a schema, `*` for any name in a map; lists add nothing."""
    if "$ref" in part:
        yield from fields(schema, schema["$defs"][part["$ref"].rpartition("/")[2]], path)
    for name, below in part.get("properties", {}).items():
        yield (*path, name)
        yield from fields(schema, below, (*path, name))
    for key, more in (("items", ()), ("additionalProperties", ("*",))):
        if isinstance(part.get(key), dict):
            yield from fields(schema, part[key], (*path, *more))
    for pattern, below in part.get("patternProperties", {}).items():
        if isinstance(below, dict) and pattern != "^x-":
            yield from fields(schema, below, (*path, "*"))
    for key in ("anyOf", "oneOf", "allOf"):
        for below in part.get(key, ()):
            yield from fields(schema, below, path)


def table_of(tool: str, kind: str) -> Table:
    return TOOLS[tool].EDF if kind == "edf" else TOOLS[tool].CDF


@pytest.mark.parametrize(("tool", "kind"), KINDS_OF_FILE)
def test_no_field_is_unclassified(tool: str, kind: str) -> None:
    schema = data.schema(kind)
    found = set(fields(schema, schema))
    assert len(found) > 50
    table = table_of(tool, kind)
    # a map of names has no line itself: each of its fields has one
    above = {path for path in found if any(key.startswith(f"{'.'.join(path)}.") for key in table)}
    missing = [".".join(path) for path in sorted(found - above) if rule_of(table, path) is None]
    assert missing == []


@pytest.mark.parametrize(("tool", "kind"), KINDS_OF_FILE)
def test_every_line_is_a_field(tool: str, kind: str) -> None:
    schema = data.schema(kind)
    found = {".".join(path) for path in fields(schema, schema)}
    assert sorted(set(table_of(tool, kind)) - found) == []


@pytest.mark.parametrize(("tool", "kind"), KINDS_OF_FILE)
def test_what_is_not_exact_says_why(tool: str, kind: str) -> None:
    for key, (what, words) in table_of(tool, kind).items():
        assert what in KINDS, key
        assert words or what == "exact", key


@pytest.mark.parametrize("tool", TOOLS)
def test_a_service_has_the_same_run_time_fields_as_a_cdf(tool: str) -> None:
    """What a CDF says of how its container runs is said of the service too, so it ends alike."""
    services = table_of(tool, "edf")
    for key, rule in table_of(tool, "cdf").items():
        if f"services.*.{key}" in services and key not in ("cdf", "image"):
            assert services[f"services.*.{key}"] == rule, key


@pytest.mark.parametrize(("tool", "kind"), KINDS_OF_FILE)
def test_no_program_is_named_that_fetches_whatever_a_container_has(tool: str, kind: str) -> None:
    """A `.git` among results, whose settings name programs, ran them at the next `git status`."""
    words = [rule[1] for rule in table_of(tool, kind).values() if len(rule) > 1]
    assert words and not [one for one in map(str, words) if re.search(r"\bcp\b", one)]
