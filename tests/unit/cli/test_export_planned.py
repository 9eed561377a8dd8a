"""An export of a plan that another machine wrote, with an inventory of the user's beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.facts.document import facts_document
from srprov.planning.plan import Plan
from srprov.planning.planfile import PlanFile, dump
from tests.unit.assignment.worlds import robot

GIVEN = ("-i", "inv.yml", "--facts", "facts.json", "-o", "out")


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with an inventory, as the current one."""
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}}}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path


def write(lab: Path, edf: str, placed: dict[str, str], unreachable: Mapping[str, str]) -> None:
    """Write an EDF, somebody else's plan of it, and facts of those robots that can be reached."""
    (lab / "e.edf").write_text(edf)
    away = dict.fromkeys(placed.values(), "away")
    plan = Plan(instance="demo", source="lab@desk:e.edf", steps=(), assignment=placed, unreachable=away)
    (lab / "p.json").write_text(dump(PlanFile(plan=plan, fingerprints={}, inputs={"e.edf": edf})))
    there = sorted(set(placed.values()) - unreachable.keys())
    facts = {name: robot(name, underlay_address=f"192.0.2.{name[1]}") for name in there}
    (lab / "facts.json").write_text(json.dumps(facts_document(facts, dict(unreachable))))


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
def test_no_file_of_the_inventory_is_copied_unasked(lab: Path, capsys: pytest.CaptureFixture[str], tool: str) -> None:
    """That a file is a key may be said by the inventory alone."""
    edf = "edf: 1\nname: demo\nservices: {a: {image: busybox, volumes: ['./ws:/ws']}}\n"
    write(lab, edf, {"a": "r1"}, {})
    (lab / "ws").mkdir()
    (lab / "ws" / "key").write_text("of a form that nobody knows\n")
    (lab / "inv.yml").write_text(f"all: {{hosts: {{r1: {{ansible_ssh_private_key_file: {lab}/ws/key}}}}}}\n")
    for file in ("e.edf", "p.json"):
        assert run(["export", tool, file, *GIVEN]) == 9
        assert f"a: outside ({lab}/ws/key)" in capsys.readouterr().err
        assert not (lab / "out").exists()


def test_why_the_address_of_a_robot_is_not_known_is_said(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edf = "edf: 1\nname: demo\nservices: {db: {image: busybox}, web: {image: busybox}}\n"
    write(lab, edf, {"db": "r1", "web": "r2"}, {"r1": "no route to it"})
    assert run(["export", "compose", "p.json", *GIVEN]) == 5
    said = capsys.readouterr().err
    assert "unreachable: r1: no route to it\n" in said
    assert "the address of r1 is not known" in said and "give -i INVENTORY that has it" in said


@pytest.mark.parametrize("tool", ["compose", "swarm", "kubernetes"])
def test_a_plan_of_a_stranger_places_no_service_elsewhere_than_its_edf_does(
    lab: Path, capsys: pytest.CaptureFixture[str], tool: str
) -> None:
    """Whoever is root on r2 would have the secret of `db`; and who runs the others is said to be the plan's word."""
    edf = "edf: 1\nname: demo\nservices: {db: {image: busybox, robot: r1}, login: {image: busybox}, "
    edf += "web: {image: busybox, replicas: 2}}\n"
    write(lab, edf, {"db": "r2", "web-1": "r2", "web-2": "r2"}, {})
    assert run(["export", tool, "p.json", *GIVEN]) == 5
    assert "the plan places db on r2, and its EDF has it on r1" in capsys.readouterr().err
    assert not (lab / "out").exists()
    write(lab, edf, {"db": "r1", "web-1": "r2", "web-2": "r2"}, {})
    assert run(["export", tool, "p.json", *GIVEN]) == 0
    said, readme = capsys.readouterr().err, (lab / "out" / "README.md").read_text().replace("\\", "")
    for told in ("r1 runs db", "r2 runs web-1, web-2", "no robot runs login"):
        line = f"{told} by the word of the plan, which was not written here"
        assert f"note: {line}\n" in said and line in readme
