"""Whatever bytes a file holds, it is read or refused; nothing else is raised, and nothing takes long."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from srprov.cli.problems import as_json, as_sarif, render_problems
from srprov.data import schema
from srprov.definitions import check_files, load_inventory
from srprov.errors import DefinitionError
from srprov.yamldoc import loader
from tests.bounded import within
from tests.conftest import examples
from tests.unit.definitions.examples import BASE, CDF, EDF, INVENTORY, write_full

QUICK = settings(
    max_examples=examples(100),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
PIECES = st.sampled_from(
    [
        *'[]{}:,-&*!|>"#%@`\\\t\n',
        *("<<: *quiet", "!!binary x", "? ", "\x00", "\x85", "\ud7ff", "9" * 30, "[" * 80, "../" * 9, "-0", "0x_", "'"),
        *("null", "~", "1e999", ".nan", "{{ x }}", "!vault x", "&a [*a]"),
    ]
)


def _survives(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    problems = check_files([path])
    for render in (render_problems, as_json, as_sarif):
        assert isinstance(render(problems), str)


@pytest.mark.parametrize("name", ["e.edf", "t.cdf", "hosts.yml", "hosts", "Dockerfile", "hosts.ini"])
@settings(QUICK, max_examples=examples(60))
@given(content=st.binary(max_size=200))
def test_random_bytes(tmp_path: Path, name: str, content: bytes) -> None:
    _survives(tmp_path / name, content)


@st.composite
def _mutated(draw: Callable[..., Any], text: str) -> str:
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        text = text[:start] + draw(PIECES | st.text(max_size=6)) + text[end:]
    return text


@pytest.mark.parametrize(
    ("name", "text"), [("e.edf", EDF), ("t.cdf", CDF), ("base.cdf", BASE), ("hosts.yml", INVENTORY)]
)
@QUICK
@given(data=st.data())
def test_mutated_documents(tmp_path: Path, name: str, text: str, data: st.DataObject) -> None:
    if not (tmp_path / "experiment.edf").exists():
        write_full(tmp_path)
    _survives(tmp_path / name, data.draw(_mutated(text)).encode("utf-8", "surrogatepass"))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | PIECES | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(PIECES | st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


def _examples(kind: str) -> st.SearchStrategy[dict[str, Any]]:
    """Return documents whose fields hold examples of the schema, or anything at all."""
    root = schema(kind)
    fields = {}
    for name, field in root["properties"].items():
        target = root["$defs"][field["$ref"].rsplit("/", 1)[-1]] if "$ref" in field else field
        fields[name] = st.sampled_from(target["examples"]) | JSON
    return st.fixed_dictionaries({}, optional=fields)


@pytest.mark.parametrize("kind", ["edf", "cdf"])
@QUICK
@given(data=st.data())
def test_any_values_in_any_fields(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    _survives(tmp_path / f"a.{kind}", json.dumps(data.draw(_examples(kind))).encode())


@QUICK
@given(data=st.data())
def test_any_values_in_a_services_fields(tmp_path: Path, data: st.DataObject) -> None:
    root = schema("edf")
    fields = {}
    for name, field in root["properties"]["services"]["additionalProperties"]["properties"].items():
        if name == "image":
            continue
        target = root["$defs"][field["$ref"].rsplit("/", 1)[-1]] if "$ref" in field else field
        fields[name] = st.sampled_from(target["examples"]) | st.sampled_from(target["examples"]) | JSON
    service = data.draw(st.fixed_dictionaries({"image": st.just("x")}, optional=fields))
    document = {"edf": 1, "name": "a", "services": {"a": service, "roscore": {"image": "y"}}}
    _survives(tmp_path / "a.edf", json.dumps(document).encode())


@QUICK
@given(value=st.dictionaries(st.sampled_from(["all", "g", "h"]), JSON, max_size=3), host=JSON, variables=JSON)
def test_any_inventory(tmp_path: Path, value: dict[str, object], host: object, variables: object) -> None:
    names = ["ansible_host", "ansible_port", "ansible_user", "srprov_tags", "srprov_slots", "ansible_ssh_common_args"]
    document = {"z": {"hosts": {"r1": host, "r2": dict.fromkeys(names, variables)}, "children": host}, **value}
    _survives(tmp_path / "hosts.yml", json.dumps(document).encode())


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "{a: " * 50_000,
        "- " * 50_000 + "a",
        "a: &a [1]\n" + "b: [*a" + ", *a" * 200_000 + "]\n",
        "x: &x {a: 1}\n" + "".join(f"k{i}: &k{i} {{n: *{'x' if i == 0 else f'k{i - 1}'}}}\n" for i in range(200)),
        "\n".join(f"k{i}: 1" for i in range(120_000)),
        "? " * 10_000,
    ],
    ids=["lists", "maps", "dashes", "aliases", "deep aliases", "many keys", "question marks"],
)
def test_limits_hold_before_memory_or_stack_run_out(text: str) -> None:
    with within(10), pytest.raises(DefinitionError):
        loader.parse(text, "x")


def test_a_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    with open(tmp_path / "a.edf", "wb") as stream:
        stream.truncate(loader.MAX_BYTES + 1)
    assert "larger than 8 MiB" in check_files([tmp_path / "a.edf"])[0].message


def test_many_robots_load_quickly(tmp_path: Path) -> None:
    hosts = "".join(f"    robot{i}: {{srprov_slots: 2, ansible_host: 10.0.0.1}}\n" for i in range(1000))
    (tmp_path / "i.yml").write_text(f"robots:\n  vars: {{ansible_user: x}}\n  hosts:\n{hosts}")
    with within(5):
        assert len(load_inventory([tmp_path / "i.yml"]).hosts) == 1000


@pytest.mark.parametrize(
    ("name", "text", "place"),
    [
        ("h.ini", "[g]\na\n[g:vars]\nansible_ssh_private_key_file='/x/\\ud800'\n", (4, 30)),
        ("h.ini", "a srprov_tags=\"['\\ud800']\"\n", (1, 15)),
        ("h.ini", "a x=\"{'\\udfff': 1}\"\n", (1, 5)),
        ("h.sh", """#!/bin/sh\necho '{"g": {"hosts": ["a"], "vars": {"x": "\\ud800"}}}'\n""", (1, 1)),
    ],
)
def test_half_a_character_is_refused_where_it_stands(
    tmp_path: Path, name: str, text: str, place: tuple[int, int]
) -> None:
    """No path or command can hold one."""
    path = tmp_path / name
    path.write_text(text)
    path.chmod(0o700 if name == "h.sh" else 0o600)
    with pytest.raises(DefinitionError) as refused:
        load_inventory([path])
    (found,) = refused.value.problems
    assert (found.location.line, found.location.column) == place and "half a character" in found.message


def test_a_whole_pair_is_a_character_and_a_backslash_makes_python_warn_of_nothing(tmp_path: Path) -> None:
    (tmp_path / "h.ini").write_text("a srprov_tags=\"['\\U0001f916', 'q\\q']\"\n")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        inventory = load_inventory([tmp_path / "h.ini"])
    assert inventory.hosts["a"].tags == ("\U0001f916", "q\\q") and not warned
