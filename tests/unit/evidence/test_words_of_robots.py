"""A robot says which addresses and serial number it has: they are private, and change nothing that a bundle says."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from srprov.errors import UsageError
from srprov.evidence.make import bundle
from srprov.evidence.verify import verify
from tests.trial_folders import EDF, FILES, MACHINE, run_folder, write_experiment
from tests.unit.evidence.bundles import unpacked

TAG = "0123456789abcdef0123456789abcdef"
IMAGE = f"srprov/runner:{TAG}"


def changed(run: Path, to: Path, **said: object) -> Path:
    """Return a copy of a run in which r2 says something else of itself."""
    folder = Path(shutil.copytree(run, to))
    for home in folder.glob("sessions/*"):
        facts, hardware = (json.loads((home / name).read_text()) for name in ("facts.json", "hardware.json"))
        facts["robots"]["r2"] |= said
        (home / "facts.json").write_text(json.dumps(facts))
        if word := said.get("machine_id"):
            hardware["tokens"][word] = "f" * 32
            (home / "hardware.json").write_text(json.dumps(hardware))
    return folder


def links(*addresses: str) -> list[dict[str, object]]:
    return [{"name": "lo", "addresses": list(addresses), "mac": "", "mtu": 65536}]


def test_no_address_of_a_robot_is_replaced_that_the_experiment_names(tmp_path: Path) -> None:
    """As the value of a parameter it says what was run; an honest robot may have it as well."""
    edf = EDF.replace("parameters:\n", "parameters:\n  PEER: {values: [10.9.8.7]}\n")
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "experiment", {**FILES, "race.edf": edf}))
    bundle(changed(run, tmp_path / "lies", links=links("10.9.8.7/32", "10.9.8.70/32")), tmp_path / "b.zip")
    assert b"10.9.8.7" in unpacked(tmp_path / "b.zip")["trials.csv"]
    assert b"10.9.8.70" not in unpacked(tmp_path / "b.zip")["sessions/1/facts.json"]
    assert not [one.id for one in verify(str(tmp_path / "b.zip")).findings if one.result == "fail"]


@pytest.mark.parametrize(
    ("value", "address"),
    [
        ("10.9.8.7-10.9.8.20", "10.9.8.7/32"),
        ("http://10.9.8.7-a.lab", "10.9.8.7/32"),
        ("10.9.8.7\u00e9", "10.9.8.7/32"),
        ("\u00e910.9.8.7", "10.9.8.7/32"),
        ("fe80::1-x", "fe80::1/64"),
        ("/home/alice/maps", "10.9.8.7/32"),
    ],
)
def test_what_would_be_replaced_in_a_value_stays(tmp_path: Path, value: str, address: str) -> None:
    """Whatever stands beside an address; and a home, which is replaced whoever has it."""
    edf = EDF.replace("parameters:\n", f"parameters:\n  PEER: {{values: ['{value}']}}\n")
    run = run_folder(tmp_path / "run", write_experiment(tmp_path / "experiment", {**FILES, "race.edf": edf}))
    bundle(changed(run, tmp_path / "said", links=links(address)), tmp_path / "b.zip")
    assert value.encode() in unpacked(tmp_path / "b.zip")["trials.csv"]
    assert not [one.id for one in verify(str(tmp_path / "b.zip")).findings if one.result == "fail"]


@pytest.mark.parametrize("what", ["image", "token"])
def test_no_serial_number_of_a_robot_is_what_an_image_or_another_robot_is_called(
    run: Path, tmp_path: Path, what: str
) -> None:
    """The content tag of an image that srprov built, and what stands for another one's serial number in a bundle."""
    tokens = json.loads((run / "sessions/1/hardware.json").read_text())["tokens"]
    word = TAG if what == "image" else tokens[MACHINE]
    folder = changed(run, tmp_path / "lies", machine_id=word)
    plan = folder / "sessions/1/plan.json"
    plan.write_text(json.dumps({**json.loads(plan.read_text()), "notes": [IMAGE]}))
    bundle(folder, tmp_path / "b.zip")
    found = unpacked(tmp_path / "b.zip")
    assert IMAGE in json.loads(found["sessions/1/plan.json"])["notes"]
    after = json.loads(found["sessions/1/facts.json"])["robots"]
    assert after["r1"]["machine_id"] == tokens[MACHINE]
    assert after["r2"]["machine_id"] == "f" * 32


def test_an_address_is_private_also_where_a_robot_is_called_so(run: Path, tmp_path: Path) -> None:
    """As with `-i 10.9.8.7,`."""
    folder = changed(run, tmp_path / "run", links=links("10.9.8.7/32"))
    for path in folder.glob("sessions/*/facts.json"):
        facts = json.loads(path.read_text())
        facts["robots"]["10.9.8.7"] = facts["robots"]["r2"]
        path.write_text(json.dumps(facts))
    bundle(folder, tmp_path / "b.zip")
    assert b"10.9.8.7" not in unpacked(tmp_path / "b.zip")["sessions/1/facts.json"]


def rewritten(path: Path, change: Callable[[Any], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("name", "private", "change"),
    [
        *(
            ("hardware.json", MACHINE, lambda all, token=token: all["tokens"].update({MACHINE: token}))
            for token in ("", None, 0)
        ),
        ("environment.json", "bobtheowner", lambda all: all.update(owner="bobtheowner")),
        ("facts.json", "bobsrobot", lambda all: all["robots"].update({"": {"hostname": "bobsrobot"}})),
    ],
)
def test_what_has_no_word_that_stands_for_it_is_hidden_all_the_same(
    run: Path, tmp_path: Path, name: str, private: str, change: Callable[[Any], object]
) -> None:
    """Serial numbers without a token, an owner without a host and a robot without a name: in strange records only."""
    folder = Path(shutil.copytree(run, tmp_path / "strange"))
    rewritten(folder / "sessions/1" / name, change)
    rewritten(folder / "sessions/1/plan.json", lambda plan: plan.update(notes=[f"says {private}"]))
    bundle(folder, tmp_path / "b.zip")
    found = unpacked(tmp_path / "b.zip")
    assert not [path for path, content in found.items() if private.encode() in content]


def test_a_host_without_a_name_is_no_robot_of_a_record(run: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(run, tmp_path / "strange"))
    hosts = {"": {"ansible_host": "bobs.lab.example"}}
    rewritten(folder / "sessions/1/inputs/inventory.yml", lambda all: all["all"]["hosts"].update(hosts))
    with pytest.raises(UsageError, match="the record of the robots cannot be read"):
        bundle(folder, tmp_path / "b.zip")
