"""`facts --json` and the table."""

import json
import os
from pathlib import Path

import jsonschema
import pytest
from msgspec.structs import replace
from robot_outputs import COMPUTER, LATER, PI, replies

from srprov import data
from srprov.cli.facts_table import facts_table
from srprov.definitions.model import Host
from srprov.errors import UsageError
from srprov.facts.document import facts_document, facts_json
from srprov.facts.hardware import TAGS
from srprov.facts.host import parse_host
from srprov.facts.model import Docker, HostFacts, Link
from srprov.facts.stored import read_facts

ROOT = Path(__file__).parents[3]
ONE = parse_host(Host(name="robot1", address="a"), replies(COMPUTER), None, later=LATER)
PI7 = parse_host(Host(name="turtle7", address="a"), replies(PI, None), None)


def test_the_document_is_what_its_schema_says() -> None:
    document = facts_document({"turtle7": PI7, "robot1": ONE}, {"robot3": "connection refused"})
    schema = data.schema("facts")
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(json.loads(json.dumps(document)), schema)
    assert list(document["robots"]) == ["robot1", "turtle7"]
    assert document["robots"]["turtle7"]["docker"] is None


def test_the_schema_names_every_field_and_describes_it() -> None:
    definitions = data.schema("facts")["$defs"]
    for kind, name in ((HostFacts, "robot"), (Docker, "docker"), (Link, "link")):
        properties = definitions[name]["properties"]
        assert list(properties) == list(kind.__struct_fields__)
        assert all(value["description"].endswith(".") for value in properties.values())


def test_what_was_stored_is_read_back_as_it_was() -> None:
    """A field of another type than these would be lost, or refused."""
    kinds = {str(kind) for name, kind in HostFacts.__annotations__.items() if name not in ("links", "docker")}
    assert kinds == {"str", "int", "float", "bool", "tuple[str, ...]"}
    for one in (ONE, PI7):
        assert read_facts(one.name, json.loads(json.dumps(facts_json(one)))) == one


@pytest.mark.parametrize("address", ["192.0.2.2\n198.51.100.6 robot2", "db", "fe80::1%x\ny"])
def test_the_address_of_stored_facts_is_plain(address: str) -> None:
    """As of those that are asked for: it stands in hosts files and exports, and the file may be a stranger's."""
    with pytest.raises(UsageError, match="cannot be read: 'underlay_address' is no address"):
        read_facts("robot1", {**json.loads(json.dumps(facts_json(ONE))), "underlay_address": address})


def test_json_has_lists_not_tuples() -> None:
    assert facts_json(ONE)["links"][1]["addresses"] == ["192.0.2.2/24", "fd00::2/64", "fe80::fc:ff:fe00:1/64"]


def test_the_table() -> None:
    """With SRPROV_UPDATE_GOLDEN=1 the file is written anew, as those of plans are."""
    golden = ROOT / "tests" / "golden" / "facts-table.txt"
    table = facts_table({"turtle7": PI7, "robot1": ONE}, {"robot3": "connection refused\n  is the robot on?"})
    if os.environ.get("SRPROV_UPDATE_GOLDEN"):
        golden.write_text(table, encoding="utf-8")
    assert table == golden.read_text(encoding="utf-8")


def test_an_unknown_speed_is_a_question_mark() -> None:
    assert "  ?  " in facts_table({"r": replace(ONE, speed_mbit=0.0)}, {})


def test_no_robots_is_a_heading() -> None:
    assert facts_table({}, {}).count("\n") == 1


def test_every_tag_is_in_the_manual() -> None:
    manual = (ROOT / "docs" / "facts.md").read_text(encoding="utf-8")
    for tag, how in TAGS.items():
        assert f"| `{tag}` | {how} |" in manual
