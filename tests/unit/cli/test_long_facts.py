"""`--facts FILE` of a stranger: as long as a file may be, and read in time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from srprov.cli import facts_ranges
from srprov.cli.inputs import load_inventory
from srprov.cli.main import run
from srprov.cli.stored_facts import stored_facts
from tests.bounded import within


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an EDF and an inventory."""
    (tmp_path / "e.edf").write_text("edf: 1\nname: d\nservices: {a: {image: x}}\n")
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def assign() -> int:
    return run(["assign", "e.edf", "-i", "inv.yml", "--facts", "facts.json"])


LONG: dict[str, tuple[dict[str, Any], str]] = {
    "tags": ({"r1": {"tags": ["a"] * 1_400_000}}, "'r1' cannot be read: 'tags' has 1400000 entries; 8192 are the most"),
    "devices": ({"r1": {"devices": [f"/dev/{i}" for i in range(500_000)]}}, "'devices' has 500000 entries"),
    "links": (
        {"r1": {"links": [{"name": f"e{i}"} for i in range(200_000)]}},
        "facts of 200000 links of robots; 100000",
    ),
    "links of one": ({"r1": {"links": [{"name": "e"}] * 8193}}, "'links' has 8193 entries; 8192 are the most"),
    "addresses": ({"r1": {"links": [{"name": "e", "addresses": ["a"] * 8193}]}}, "'addresses' has 8193 entries"),
    "robots": ({f"r{i}": {} for i in range(10_001)}, "there are facts of 10001 robots; 10000 are the most"),
    "links that cannot be": ({"r1": {"links": [{"name": "e" * 30, "vni": -1, "port": -1}] * 8192}}, "'links."),
}


@pytest.mark.parametrize("case", LONG)
def test_facts_of_more_than_there_can_be_are_refused_in_time(
    lab: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    """Whatever is in a file of 8 MiB: a stranger's waits for no schema that is asked for each entry."""
    robots, why = LONG[case]
    (lab / "facts.json").write_text(json.dumps({"robots": robots}, separators=(",", ":")))
    assert assign() == 5  # what is imported first takes its time
    with within(2):
        assert assign() == 5
    assert why in capsys.readouterr().err


MANY: dict[str, dict[str, Any]] = {
    "robots": {f"r{i}": {"cpus": 4, "arch": "amd64", "docker": None} for i in range(10_000)},
    "links": {f"r{i}": {"links": [{"name": "e"}] * 2000} for i in range(1, 50)},
    "tags": {f"r{i}": {"tags": ["a"] * 8192} for i in range(1, 200)},
}


@pytest.mark.parametrize("case", MANY)
def test_facts_of_very_many_robots_are_read_in_time(lab: Path, case: str) -> None:
    (lab / "facts.json").write_text(json.dumps({"robots": MANY[case]}, separators=(",", ":")))
    inventory = load_inventory(("inv.yml",))
    with within(2):
        found, _ = stored_facts(lab / "facts.json", inventory)
    assert "r1" in found.facts


_ODD = (
    None,
    True,
    0,
    -1,
    1,
    70_000,
    2**24,
    1.0,
    0.5,
    "",
    "a",
    "a" * 16,
    "1.43",
    "1.43\n",
    "kernel",
    [],
    ["a"],
    [1],
    {},
)


def test_what_passes_without_the_schema_s_library_is_what_it_lets_pass() -> None:
    """The quick look is a second reading of the schema: of each field it must say no more than the library does."""
    ranges, validator = facts_ranges._ranges(), facts_ranges._validator()
    passed = 0
    link, docker = ranges["$defs"]["link"]["properties"], ranges["$defs"]["docker"]["properties"]
    given = [{name: odd} for name in ranges["properties"] for odd in _ODD]
    given += [{"links": [{"name": "e", name: odd}]} for name in link for odd in _ODD]
    given += [{"docker": {"version": "1", "api_version": "1.43", name: odd}} for name in docker for odd in _ODD]
    for one in given:
        quick, slow = facts_ranges._fits(one, ranges, ranges["$defs"]), validator.is_valid(one)
        number = next(iter(one.values()))
        assert quick == slow or (slow and "1.0" in repr(number)), one  # which is whole for the library
        passed += quick
    assert passed > 200
