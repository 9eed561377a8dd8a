"""A page for each JSON Schema: every field with its type, its meaning and an example."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tools.site.markup import code, text

FILES = ("edf", "cdf", "inventory-vars", "playbook", "policy", "lock")
"""Schemas of files that users write; the others are of what verbs print."""
_BOUNDS = {
    "minimum": "at least",
    "maximum": "at most",
    "exclusiveMinimum": "more than",
    "exclusiveMaximum": "less than",
}


def pages(folder: Path) -> dict[str, str]:
    """Return the name of a page -> its Markdown, of all schemas in a folder."""
    schemas = {path.name.partition(".")[0]: json.loads(path.read_text("utf-8")) for path in sorted(folder.iterdir())}
    made = {f"reference/fields/{name}.md": "\n".join(_page(name, schema)) for name, schema in schemas.items()}
    return {"reference/fields.md": "\n".join(_index(schemas)), **made}


def _index(schemas: dict[str, Any]) -> Iterator[str]:
    yield from (
        "# Fields",
        "",
        "What files and JSON documents hold. `srprov schema KIND` prints the schema itself.",
        "",
    )
    listed = [*(name for name in FILES if name in schemas), *(name for name in schemas if name not in FILES)]
    yield from ("| kind | is |", "|---|---|")
    for name in listed:
        yield f"| [{name}](fields/{name}.md) | {text(schemas[name].get('description', ''))} |"
    yield from ("", "```{toctree}", ":hidden:", "", *(f"fields/{name}" for name in listed), "```", "")


def _page(kind: str, schema: dict[str, Any]) -> Iterator[str]:
    yield from (f"# {kind}", "", text(schema.get("description", schema.get("title", ""))), "")
    yield from _object(kind, schema)
    for name, part in sorted(schema.get("$defs", {}).items()):
        yield from (f"({_anchor(kind, name)})=", f"## {name}", "")
        yield from ([text(part["description"]), ""] if "description" in part else [])
        yield from (_object(kind, part) if _fields_of(part) else [f"{_type(kind, part)}.", ""])


def _object(kind: str, part: dict[str, Any]) -> Iterator[str]:
    rows = list(_rows(kind, part, ""))
    if rows:
        yield from ("| field | takes | meaning | example |", "|---|---|---|---|", *rows, "")


def _rows(kind: str, part: dict[str, Any], above: str) -> Iterator[str]:
    """Yield a row for each field, those inside it below it."""
    needed = part.get("required", ())
    for name, field in part.get("properties", {}).items():
        path = f"{above}{name}"
        examples = field.get("examples", ())
        example = code(json.dumps(examples[0], ensure_ascii=False)) if examples else ""
        must = " (required)" if name in needed else ""
        meaning = text(field.get("description", ""))
        yield f"| {code(path)}{must} | {_type(kind, field)} | {meaning} | {example} |"
        for inner, mark in _below(field):
            yield from _rows(kind, inner, f"{path}{mark}")


def _below(field: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield the objects within a field that have fields of their own, with how a path goes on there."""
    for one in (field, *field.get("anyOf", ()), *field.get("oneOf", ())):
        if "properties" in one:
            yield one, "."
        for key, mark in (("items", "[]."), ("additionalProperties", ".*.")):
            if isinstance(one.get(key), dict):
                yield from ((inner, mark[:-1] + step) for inner, step in _below(one[key]))


def _fields_of(part: dict[str, Any]) -> bool:
    return bool(part.get("properties"))


def _type(kind: str, part: dict[str, Any]) -> str:
    """Return what a field takes, in words."""
    if "$ref" in part:
        name = part["$ref"].rpartition("/")[2]
        return f"[{name}](#{_anchor(kind, name)})"
    if "const" in part:
        return code(json.dumps(part["const"]))
    if "enum" in part:
        return ", ".join(code(json.dumps(value)) for value in part["enum"])
    for key in ("anyOf", "oneOf"):
        if key in part:
            return " or ".join(dict.fromkeys(_type(kind, one) for one in part[key]))
    named = part.get("type", [])
    types = [named] if isinstance(named, str) else named
    return " or ".join(_plain(kind, one, part) for one in types) or "any value"


def _plain(kind: str, name: str, part: dict[str, Any]) -> str:
    if name == "array" and isinstance(part.get("items"), dict):
        return f"list of {_type(kind, part['items'])}"
    if name == "object" and isinstance(part.get("additionalProperties"), dict):
        return f"map of {_type(kind, part['additionalProperties'])}"
    bounds = [f"{words} {part[key]}" for key, words in _BOUNDS.items() if key in part]
    word = {"string": "text", "object": "map", "array": "list", "null": "nothing", "integer": "whole number"}
    return ", ".join([word.get(name, name), *(bounds if name in ("integer", "number") else [])])


def _anchor(kind: str, name: str) -> str:
    return f"{kind}-{name}".lower().replace("_", "-").replace(".", "-")
