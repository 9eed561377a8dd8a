"""A file of another kind: one sentence says which it is and what to do with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.codes import Code
from srprov.definitions import load_container, load_experiment, load_inventory
from srprov.errors import DefinitionError, Diagnostic

COMPOSE = "services:\n  a:\n    image: x\n    container_name: a\n    networks: [n]\nnetworks: {n: {}}\n"
SWARMROB = "version: '3'\nservices:\n  a:\n    image: x\n    environment: [A=1]\n"
POD = "apiVersion: v1\nkind: Pod\nmetadata: {name: a}\nspec: {containers: [{name: a, image: x}]}\n"
PLAY = "- hosts: all\n  become: true\n  tasks:\n    - ansible.builtin.apt: {name: curl}\n"
PLAYS = "- import_playbook: site.yml\n"
YAML_INVENTORY = "all:\n  hosts:\n    r1: {ansible_host: 10.0.0.1}\n  children: {arms: {hosts: {r1: }}}\n"
GROUPS = "arms:\n  hosts:\n    r1:\n    r2:\n"
INI = "# ours\n[arms]\nr1 ansible_host=10.0.0.1\n[arms:vars]\nansible_user=pi\n"
EDF = "edf: 1\nname: a\nservices: {a: {image: x}}\n"
CDF = "cdf: 1\nimage: x\n"


def told(path: Path, kind: str) -> list[Diagnostic]:
    """Read a file as one of a kind, and return what is wrong."""
    load = {"edf": load_experiment, "cdf": load_container, "inventory": lambda one: load_inventory([one])}[kind]
    try:
        load(path)
    except DefinitionError as error:
        return list(error.problems)
    return []


@pytest.mark.parametrize(
    ("text", "wanted", "says", "hint"),
    [
        (COMPOSE, "edf", "this is a Compose file, not an EDF", "srprov import compose"),
        (COMPOSE, "cdf", "this is a Compose file, not a CDF", "srprov import compose"),
        (COMPOSE, "inventory", "this is a Compose file, not an inventory", "srprov import compose"),
        (SWARMROB, "edf", "this is a Compose file or a definition of SwarmRob, not an EDF", "srprov import swarmrob"),
        (POD, "edf", "this is a file of Kubernetes, not an EDF", "does not import"),
        (f"{POD}---\n{POD}", "edf", "this is a file of Kubernetes, not an EDF", "does not import"),
        (POD, "inventory", "this is a file of Kubernetes, not an inventory", "does not import"),
        (PLAY, "edf", "this is a playbook of Ansible, not an EDF", "docs/from-ansible.md"),
        (PLAYS, "edf", "this is a playbook of Ansible, not an EDF", "docs/from-ansible.md"),
        (PLAY, "inventory", "this is a playbook of Ansible, not an inventory", "docs/from-ansible.md"),
        (YAML_INVENTORY, "edf", "this is an inventory, not an EDF", "-i"),
        (GROUPS, "edf", "this is an inventory, not an EDF", "-i"),
        (INI, "edf", "this is an inventory, not an EDF", "-i"),
        ("[arms]\n", "edf", "this is an inventory, not an EDF", "-i"),
        (INI, "cdf", "this is an inventory, not a CDF", "-i"),
        (EDF, "inventory", "this is an EDF, not an inventory", "-i"),
        (EDF, "cdf", "this is an EDF, not a CDF", "FILE"),
        (CDF, "edf", "this is a CDF, not an EDF", "cdf: FILE"),
        (CDF, "inventory", "this is a CDF, not an inventory", "cdf: FILE"),
    ],
)
def test_a_file_of_another_kind_is_told_in_one_sentence(
    tmp_path: Path, text: str, wanted: str, says: str, hint: str
) -> None:
    path = tmp_path / "file.yml"
    path.write_text(text)
    (one,) = told(path, wanted)
    assert (one.code, one.message) == (Code.WRONG_KIND, says)
    assert hint in one.hint


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (EDF.replace("edf: 1\n", ""), "edf"),
        ("edf: 1\nname: a\nversion: 2\nservices: {a: {image: x, build: .}}\n", "edf"),
        ("name: a\nservices: {a: {cdf: a.cdf, networks: [n]}}\n", "edf"),
        ("image: x\nbuild: .\n", "cdf"),
        ("- a\n- b\n", "edf"),
        ("name: a\nhosts: {r1: }\n", "edf"),
    ],
)
def test_what_may_be_a_draft_of_the_right_kind_is_told_all_that_is_wrong(
    tmp_path: Path, text: str, wanted: str
) -> None:
    path = tmp_path / "file.yml"
    path.write_text(text)
    found = told(path, wanted)
    assert found and Code.WRONG_KIND not in [one.code for one in found]


@pytest.mark.parametrize(
    "text",
    [
        "services:\n  hosts:\n    build: {ansible_host: 10.0.0.1}\n    scale:\n",
        "edf: {hosts: {r1: }}\ncdf: {hosts: {r2: }}\n",
        "all: {hosts: {r1: }}\nservices: {hosts: {r1: }}\n",
    ],
)
def test_an_inventory_may_have_groups_of_any_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "hosts.yml"
    path.write_text(text)
    assert told(path, "inventory") == []


def test_a_file_that_is_named_like_compose_names_its_is_one(tmp_path: Path) -> None:
    path = tmp_path / "docker-compose.yml"
    path.write_text("services: {a: {image: x}}\n")
    assert [one.code for one in told(path, "edf")] == [Code.WRONG_KIND]


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("services: {a: {image: x, environment: RATE:2}}", "YAML wants a space behind the colon: `RATE: …`"),
        ("services: {a: x:1}", "YAML wants a space behind the colon: `x: …`"),
        ("services: {a: {image: x, environment: http://x}}", ""),
        ("services: {a: {image: x, environment: 'RATE:2'}}", ""),
        (
            "services:\n  a:\n    image x\n    # why\n    init: true",
            "it begins on line 4; is a ':' missing above, or is",
        ),
        ("services: {a: {cdf: talkr.cdf}}", "did you mean 'talker.cdf'?"),
        ("services: {a: {cdf: x/talker.cdf}}", "it is looked for at "),
    ],
)
def test_a_slip_of_the_hand_is_told_with_what_to_do(tmp_path: Path, text: str, hint: str) -> None:
    (tmp_path / "talker.cdf").write_text(CDF)
    edf = tmp_path / "e.edf"
    edf.write_text(f"edf: 1\nname: a\n{text}\n")
    (one,) = told(edf, "edf")
    assert one.hint.startswith(hint) and bool(one.hint) == bool(hint), one
