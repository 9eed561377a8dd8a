"""`srprov diff`: what a change of an EDF would change, from stored facts, as text, JSON and Markdown."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from msgspec.structs import replace

from srprov import data
from srprov.cli.main import run
from srprov.facts.document import facts_document
from srprov.facts.model import Docker
from srprov.secret import forget
from tests.unit.assignment.worlds import robot

OLD = """\
edf: 1
name: demo
secrets: {token: {env: TOKEN}}
services:
  cam: {image: busybox, robot: r1, environment: {RATE: "2"}, volumes: ["./app.yml:/etc/app.yml"]}
  nav: {image: busybox, cost: 50, secrets: [token]}
  gone: {image: busybox, robot: r2}
"""
NEW = """\
edf: 1
name: demo
secrets: {token: {env: TOKEN}}
services:
  cam: {image: busybox, robot: r1, environment: {RATE: "4"}, volumes: ["./app2.yml:/etc/app.yml"], command: [serve]}
  nav: {image: busybox, cost: 50, secrets: [token]}
  more: {image: busybox, robot: r2, network: none}
"""


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with two EDFs, an inventory and facts of three robots."""
    (tmp_path / "old.edf").write_text(OLD)
    (tmp_path / "new.edf").write_text(NEW)
    (tmp_path / "app.yml").write_text("a: 1\nrate: 2\n")
    (tmp_path / "app2.yml").write_text("a: 1\nrate: 4\n")
    (tmp_path / "inv.yml").write_text("all: {hosts: {r1: {}, r2: {}, r3: {}}}\n")
    engine = Docker(version="27", api_version="1.46")
    facts = {
        f"r{n}": replace(robot(f"r{n}"), docker=engine, underlay_address=f"10.0.0.{n}", underlay_mtu=1500)
        for n in (1, 2, 3)
    }
    (tmp_path / "facts.json").write_text(json.dumps(facts_document(facts, {})))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.setenv("TOKEN", "canary-55219")
    forget()
    return tmp_path


def diff(*more: str, old: str = "old.edf", new: str = "new.edf") -> int:
    return run(["diff", old, new, "-i", "inv.yml", "--facts", "facts.json", "--allow", "secret", *more])


def test_what_changes_is_named_with_its_values(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Values, lines of a file, what is new and gone; what is the same, or the controller's bookkeeping, is not."""
    assert diff("--detailed-exitcode") == 2

    text = capsys.readouterr().out
    lines = [line.strip() for line in text.splitlines()]
    for expected in ("environment.RATE: 2 -> 4", "command: (not set) -> serve", "-rate: 2", "+rate: 4"):
        assert expected in lines
    assert "container srprov.demo.gone: no longer needed" in text
    assert "container srprov.demo.more: new" in text
    assert "srprov.demo.nav" not in text
    assert "hash" not in text
    assert "canary" not in text


def test_the_same_file_changes_nothing(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Under another name too."""
    (lab / "same.edf").write_text(OLD)

    assert diff("--detailed-exitcode", new="same.edf") == 0
    assert "Nothing to do" in capsys.readouterr().out


def test_json_and_markdown(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """JSON is a plan's, without commands and hash; Markdown has the values in a block."""
    assert diff("--json") == 0
    found = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator(data.schema("plan")).validate(found)
    assert "hash" not in found
    assert all(step["commands"] == [] for step in found["steps"])
    (cam,) = (step for step in found["steps"] if step["name"] == "srprov.demo.cam")
    assert {"field": "environment.RATE", "old": "2", "new": "4"} in cam["differences"]

    assert diff("--format", "markdown") == 0
    text = capsys.readouterr().out
    assert "- environment.RATE: 2\n+ environment.RATE: 4\n" in text
    assert "<!--" not in text


def test_a_service_that_moves_says_from_where(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its values are compared with those that it had there."""
    (lab / "new.edf").write_text(OLD.replace("robot: r1", "robot: r3").replace('"2"', '"5"'))

    assert diff() == 0

    text = capsys.readouterr().out
    assert "container srprov.demo.cam: moved to r3" in text
    assert "container srprov.demo.cam: moved from r1" in text
    assert "environment.RATE: 2 -> 5" in text


def test_services_stay_where_the_old_file_put_them(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A robot that became free does not draw a service to it, as it would not on real robots."""
    taken = "edf: 1\nname: demo\nservices:\n  nav: {image: busybox}\n  cam: {image: busybox, robot: r1}\n"
    (lab / "old.edf").write_text(taken)
    (lab / "new.edf").write_text(taken.replace("robot: r1", "robot: r3"))

    assert diff() == 0

    text = capsys.readouterr().out
    assert "container srprov.demo.cam: moved to r3" in text
    assert "srprov.demo.nav" not in text
