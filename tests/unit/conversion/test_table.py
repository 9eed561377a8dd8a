"""The table of keys: none of the Compose specification is without a class, and docs and findings go by it."""

from __future__ import annotations

import json
import mmap
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.conversion import matrix
from srprov.conversion.kept import Kept
from srprov.conversion.table import TABLE, VERSION, key_of, kinds, row_of
from tests import compose_oracle
from tests.unit.conversion.making import draft, project
from tests.unit.conversion.test_services import CASES, cases

ROOT = Path(__file__).parents[3]
KEYS = (CASES / f"keys-{VERSION}.txt").read_text(encoding="utf-8").split()
"""Every key of the JSON schema that Docker Compose of this version has inside."""


def keys_of(schema: dict[str, Any]) -> set[str]:
    """Give the keys that a JSON schema describes, in the table's words."""
    found: set[str] = set()

    def walk(part: dict[str, Any], path: tuple[str, ...]) -> None:
        while "$ref" in part:
            part = schema["definitions"][part["$ref"].rsplit("/", 1)[1]]
        for one in (*part.get("oneOf", ()), *part.get("anyOf", ())):
            walk(one, path)
        if isinstance(part.get("items"), dict):
            walk(part["items"], path)
        for name, one in part.get("properties", {}).items():
            found.add(".".join((*path, name)))
            walk(one, (*path, name))
        for pattern, one in part.get("patternProperties", {}).items():
            if pattern != "^x-" and isinstance(one, dict):
                walk(one, (*path, "*"))
        if isinstance(part.get("additionalProperties"), dict):
            walk(part["additionalProperties"], (*path, "*"))

    walk(schema, ())
    return found


def test_every_key_of_the_specification_has_a_class() -> None:
    assert len(KEYS) > 300
    assert [key for key in KEYS if row_of(key) is None] == []


def test_the_table_has_no_key_that_the_specification_lacks() -> None:
    assert [key for key in TABLE if key not in KEYS] == []


def test_every_row_says_why_or_where() -> None:
    """A matrix with empty cells helps nobody."""
    for row in TABLE.values():
        assert row.why or row.kept is Kept.EXACT, row
        assert row.to or row.kept in (Kept.DROPPED, Kept.REFUSED), row
        assert not any(text.endswith(".") for text in (row.why, *(when for _, when in row.but))), row


def test_the_page_has_the_table_of_now() -> None:
    page = (ROOT / "docs" / "from-compose.md").read_text(encoding="utf-8")
    assert page == matrix.replaced(page), "python -m tools.compose_matrix writes it anew"


def test_each_key_is_in_the_matrix_once() -> None:
    rows = re.findall(r"^\| `([^`]+)`", matrix.as_markdown(), re.MULTILINE)
    assert len(rows) == len(TABLE)


def _findings(tmp_path: Path) -> Iterator[tuple[str, Kept]]:
    for case in (*cases("services.yml"), *cases("mounts.yml")):
        given = case.values[0]
        services = {"a": {"image": "busybox:1", **given["given"]}, "user": {"image": "busybox:1"}}
        services["user"]["environment"] = given.get("users", {})
        for one in draft(project(services, **given.get("top", {})), tmp_path).findings:
            yield one.key, one.kept


def test_what_is_said_of_a_key_is_in_one_of_its_classes(tmp_path: Path) -> None:
    """The matrix would promise something else than the conversion does."""
    seen, wrong = 0, []
    for key, kept in _findings(tmp_path):
        pattern = key_of(tuple(int(part) if part.isdecimal() else part for part in key.split(".")))
        row = row_of(pattern)
        if row is None:  # one entry of a map or a list, or the service as a whole, or a key that nobody knows
            row = row_of(pattern.rpartition(".")[0])
        if row is not None and pattern != "services.*.quantum":
            seen += 1
            wrong += [f"{key} is {kept.value}"] if kept not in kinds(row) | {Kept.EXACT} else []
    assert not wrong, "\n".join(wrong)
    assert seen > 100


@pytest.mark.parametrize(
    ("path", "key"),
    [
        (("services", "a", "ports", 0, "mode"), "services.*.ports.mode"),
        (("services", "a", "networks", "n", "aliases"), "services.*.networks.*.aliases"),
        (("services", "a", "depends_on", "b", "condition"), "services.*.depends_on.*.condition"),
        (("volumes", "v", "driver"), "volumes.*.driver"),
        (("version",), "version"),
    ],
)
def test_places_belong_to_keys(path: tuple[str | int, ...], key: str) -> None:
    assert key_of(path) == key


@pytest.mark.skipif(not compose_oracle.AVAILABLE, reason="there is no Docker Compose for this machine")
def test_the_keys_are_those_of_the_schema_that_compose_has_inside() -> None:
    """A newer Compose would bring keys that nobody classified."""
    with compose_oracle.program().open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.rfind(b"{", 0, content.find(b'"$id": "compose_spec.json"'))
        text = content[start : start + 300_000].decode("utf-8", "replace")
    schema, _ = json.JSONDecoder().raw_decode(text)
    assert keys_of(schema) == set(KEYS)
