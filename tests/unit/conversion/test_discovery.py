"""What `x-srprov` of a Compose file says: believed in its own form alone, and harmless in any other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from srprov.cli.main import run
from srprov.conversion.discovery import restored
from srprov.definitions import load_experiment
from srprov.importing.normal import Normal

FILE = {"type": "bind", "source": "./discovery/a/x", "target": "/etc/srprov/cyclonedds.xml"}
OWN = {"type": "bind", "source": "./www", "target": "/www"}


def project(own: object) -> Normal:
    """Return a project with two services that are told something, and own words on it."""
    services = {
        name: {"environment": {"CYCLONEDDS_URI": "x", "MINE": "1"}, "volumes": [OWN, FILE]} for name in ("a", "b")
    }
    return Normal({"name": "p", "services": services, "x-srprov": own}, {})


def test_what_was_told_is_taken_out_of_the_services_that_it_names() -> None:
    own = {"discovery": "discovery-server", "discovery_servers": ["b"], "told": {"a": ["CYCLONEDDS_URI", "NONE"]}}
    normal, network = restored(project(own))
    assert network == {"discovery": "discovery-server", "discovery_servers": ["b"]}
    a, b = (normal.document["services"][name] for name in ("a", "b"))
    assert (a["environment"], a["volumes"]) == ({"MINE": "1"}, [OWN])
    assert (b["environment"]["CYCLONEDDS_URI"], b["volumes"]) == ("x", [OWN, FILE])
    assert [note.message for note in normal.warnings] == [
        "the file was exported by srprov: `network.discovery` stands for what it tells containers of each other"
    ]


@pytest.mark.parametrize(
    "own",
    [
        None, "x", [], {}, {"discovery": "ros1"}, {"discovery": "ros1", "told": []}, {"discovery": "", "told": {}},
        {"discovery": "multicast", "told": {}}, {"discovery": ["ros1"], "told": {}},
        {"discovery": {"a": 1}, "told": {}},
    ],
)  # fmt: skip
def test_what_is_not_in_its_form_says_nothing(own: object) -> None:
    given = project(own)
    assert restored(given) == (given, {})


@pytest.mark.parametrize("told", [{"a": None}, {"a": "MINE"}, {"a": {"MINE": 1}}, {"nobody": ["MINE"]}, {"a": [1, {}]}])
def test_names_that_are_none_take_nothing_away(told: dict[str, Any]) -> None:
    normal, _ = restored(project({"discovery": "ros1", "discovery_servers": 7, "told": told}))
    assert normal.document["services"]["a"]["environment"] == {"CYCLONEDDS_URI": "x", "MINE": "1"}


def test_one_file_takes_nothing_from_what_another_one_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of several may be a stranger's: the user's own service began without asking for a login."""
    monkeypatch.chdir(tmp_path)
    Path("mine.yml").write_text("name: p\nservices: {a: {image: x, environment: {LOGIN: 'yes', B: '1'}}}\n")
    Path("c.yml").write_text(
        "services: {a: {environment: {TOLD: '1'}}, b: {image: x, environment: [TOLD=1]}}\n"
        "x-srprov: {discovery: static-peers, told: {a: [LOGIN, TOLD], b: [TOLD]}}\n"
    )
    for order in (("mine.yml", "c.yml"), ("c.yml", "mine.yml")):
        assert run(["import", "compose", *order, "-o", f"out-{order[0]}"]) == 0
        found = load_experiment(f"out-{order[0]}/experiment.edf").experiment.services
        assert {name: dict(one.runtime.environment) for name, one in found.items()} == {
            "a": {"LOGIN": "yes", "B": "1"}, "b": {},
        }  # fmt: skip


def test_of_two_exports_each_takes_out_what_it_says_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their lists for one service become one list; whose the whole is, says nothing of its parts."""
    monkeypatch.chdir(tmp_path)
    Path("mine.yml").write_text(
        "name: p\nservices: {a: {image: x, environment: {LOGIN: 'yes', B: '1'}}}\n"
        "x-srprov: {discovery: static-peers, told: {a: [B]}}\n"
    )
    Path("c.yml").write_text(
        "services: {b: {image: x, environment: {TOLD: '1'}}}\n"
        "x-srprov: {discovery: static-peers, told: {a: [LOGIN], b: [TOLD]}}\n"
    )
    for order in (("mine.yml", "c.yml"), ("c.yml", "mine.yml")):
        assert run(["import", "compose", *order, "-o", f"out-{order[0]}"]) == 0
        found = load_experiment(f"out-{order[0]}/experiment.edf").experiment.services
        environment = {name: dict(one.runtime.environment) for name, one in found.items()}
        assert environment == {"a": {"LOGIN": "yes"}, "b": {}}


def test_one_file_takes_no_mount_from_what_another_one_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rules").write_text("deny all")
    Path("mine.yml").write_text("name: p\nservices: {a: {image: x, volumes: ['./rules:/etc/srprov/rules:ro']}}\n")
    Path("c.yml").write_text("services: {b: {image: x}}\nx-srprov: {discovery: static-peers, told: {a: []}}\n")
    assert run(["import", "compose", "c.yml", "mine.yml", "-o", "out"]) == 0
    found = load_experiment("out/experiment.edf").experiment.services
    assert [one.target for one in found["a"].runtime.mounts] == ["/etc/srprov/rules"]
