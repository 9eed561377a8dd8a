"""The table of classes: no field of the schemas is without a line, and no line is without a field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from srprov import data
from srprov.exporting.classes import CDF, EDF, rule_of
from srprov.exporting.model import KINDS

TABLES = {"edf": EDF, "cdf": CDF}


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


@pytest.mark.parametrize("kind", TABLES)
def test_no_field_is_unclassified(kind: str) -> None:
    schema = data.schema(kind)
    found = set(fields(schema, schema))
    assert len(found) > 50
    table = TABLES[kind]
    # a map of names has no line itself: each of its fields has one
    above = {path for path in found if any(key.startswith(f"{'.'.join(path)}.") for key in table)}
    missing = [".".join(path) for path in sorted(found - above) if rule_of(table, path) is None]
    assert missing == []


@pytest.mark.parametrize("kind", TABLES)
def test_every_line_is_a_field(kind: str) -> None:
    schema = data.schema(kind)
    found = {".".join(path) for path in fields(schema, schema)}
    assert sorted(set(TABLES[kind]) - found) == []


@pytest.mark.parametrize("kind", TABLES)
def test_what_is_not_exact_says_why(kind: str) -> None:
    for key, (what, words) in TABLES[kind].items():
        assert what in KINDS, key
        assert words or what == "exact", key


def test_a_service_has_the_same_run_time_fields_as_a_cdf() -> None:
    """What a CDF says of how its container runs is said of the service too, so it ends alike."""
    for key, rule in CDF.items():
        if f"services.*.{key}" in EDF and key not in ("cdf", "image"):
            assert EDF[f"services.*.{key}"] == rule, key
