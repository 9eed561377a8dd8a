"""The table of shapes is the schema that Docker Compose has inside: the same keys, with the same kinds of values."""

from __future__ import annotations

import json
from typing import Any

import pytest

from srprov.importing.compose.check import alternatives
from srprov.importing.compose.shapes_more import ALL_TABLES, CLOSED, PATTERNS, REQUIRED
from tests.compose_oracle import AVAILABLE, program

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="Docker Compose is there for x86-64 only")
_WORDS = {"text": "string", "bool": "boolean", "int": "integer", "number": "number", "null": "null"}


def theirs() -> dict[str, Any]:
    """Return the schema that Compose checks files with, out of the program itself."""
    content = program().read_bytes()
    found = content.index(b'"compose_spec.json"')
    begin = content.rindex(b'{\n  "$schema"', 0, found)
    schema: dict[str, Any] = json.JSONDecoder().raw_decode(content[begin : begin + 300_000].decode(errors="replace"))[0]
    return schema


def simple(node: dict[str, Any], schema: dict[str, Any]) -> list[Any]:
    """Return a schema's node as a sorted list of alternatives, in a form that ours can have too."""
    if "$ref" in node:
        return simple(schema["definitions"][node["$ref"].rpartition("/")[2]], schema)
    if "oneOf" in node:
        return _sorted([one for part in node["oneOf"] for one in simple(part, schema)])
    kinds = node.get("type", "object")
    return _sorted([_one(kind, node, schema) for kind in ([kinds] if isinstance(kinds, str) else kinds)])


def _one(kind: str, node: dict[str, Any], schema: dict[str, Any]) -> Any:
    if kind == "object":
        own = {name for name in node.get("patternProperties", {}) if name != "^x-"}
        if own:
            (pattern,) = own
            return ["map", simple(node["patternProperties"][pattern], schema)]
        fields = {name: simple(value, schema) for name, value in node.get("properties", {}).items()}
        return ["table", fields, sorted(node.get("required", []))] if fields else ["map", _ANY]
    if kind == "array":
        return ["list", simple(node["items"], schema), bool(node.get("uniqueItems"))]
    return [kind, *sorted(node.get("enum", [])), *(node[word] for word in ("minimum", "maximum") if word in node)]


_ANY = sorted([["boolean"], ["null"], ["number"], ["string"]])


def _sorted(parts: list[Any]) -> list[Any]:
    return sorted(parts, key=json.dumps)


def mine(kind: str) -> list[Any]:
    """Return a kind of our table in the same form."""
    return _sorted([_mine(one) for one in alternatives(kind)])


def _mine(kind: str) -> Any:
    if kind[0] == "@":
        fields = {name: mine(value) for name, value in ALL_TABLES[kind[1:]].items()}
        return ["table", fields, sorted(REQUIRED.get(kind[1:], ()))]
    if kind[0] in "{<":
        return ["map", mine(kind[1:-1])]
    if kind[0] == "[":
        return ["list", mine(kind.removesuffix("!")[1:-1]), kind.endswith("!")]
    word, _, bounds = kind.rstrip(")").partition("(")
    parts = [part for part in bounds.split(",") if part]
    return [_WORDS[word], *(sorted(parts) if word == "text" else [int(part) for part in parts])]


def test_the_table_is_the_schema_of_compose() -> None:
    schema = theirs()
    for name, node in schema["properties"].items():
        assert mine(ALL_TABLES["project"][name]) == simple(node, schema), name
    assert set(ALL_TABLES["project"]) == set(schema["properties"])


def test_each_key_of_a_service_is_the_same() -> None:
    schema = theirs()
    properties = schema["definitions"]["service"]["properties"]
    differ = [
        name
        for name, node in properties.items()
        if mine(ALL_TABLES["service"].get(name, "null")) != simple(node, schema)
    ]
    assert differ == []
    assert {path.rpartition(".")[2]: pattern for path, pattern in PATTERNS.items()} == {
        name: node["pattern"] for name, node in properties.items() if "pattern" in node
    }


def test_tables_without_keys_of_ones_own_are_closed_in_compose_too() -> None:
    schema = theirs()
    open_ones = {
        json.dumps(sorted(node.get("properties", {})))
        for node in _objects(schema)
        if "^x-" in node.get("patternProperties", {})
    }
    mine_open = {json.dumps(sorted(table)) for name, table in ALL_TABLES.items() if name not in CLOSED}
    assert mine_open == open_ones


def _objects(node: Any) -> list[dict[str, Any]]:
    if isinstance(node, list):
        return [found for item in node for found in _objects(item)]
    if not isinstance(node, dict):
        return []
    own = [node] if isinstance(node.get("properties"), dict) else []
    return own + [found for item in node.values() for found in _objects(item)]
